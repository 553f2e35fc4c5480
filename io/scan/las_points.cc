// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Points of a LAS file, versions 1.0 to 1.4 (ASPRS). Counts of variable length records are not
// looked at: some writers get them wrong, and the offset to the points is what counts.
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstring>

#include "io/file/text.h"
#include "io/scan/scan_formats.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kLasHead = 227, kLas14Head = 375;
constexpr std::size_t kLasVersion = 24, kLasHeadSize = 94, kLasPoints = 96, kLasFormat = 104;
constexpr std::size_t kLasRecordSize = 105, kLasCount = 107, kLasScale = 131, kLasOffset = 155;
constexpr std::size_t kLas14Count = 247;
constexpr std::uint8_t kLazBits = 0xC0;
/// Bytes of a record of formats 0 to 10.
constexpr std::array<std::uint16_t, 11> kLasRecords = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};

template <typename T>
T las_field(std::string_view bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

/// Number of points by the header: version 1.4 has a second one, and may leave the first at 0.
std::uint64_t las_count(std::string_view bytes) {
  if (las_field<std::uint8_t>(bytes, kLasVersion + 1) >= 4 && bytes.size() >= kLas14Head &&
      las_field<std::uint16_t>(bytes, kLasHeadSize) >= kLas14Head)
    if (const auto count = las_field<std::uint64_t>(bytes, kLas14Count); count > 0) return count;
  return las_field<std::uint32_t>(bytes, kLasCount);
}

/// @throw InputError unless the header is that of a file that is read
void check_las(const std::filesystem::path& file, std::string_view bytes) {
  if (bytes.size() < kLasHead)
    throw InputError(file, fmt::format("is truncated: {} bytes can't hold the header of a LAS "
                                       "file, {} bytes",
                                       bytes.size(), kLasHead));
  const auto major = las_field<std::uint8_t>(bytes, kLasVersion);
  const auto minor = las_field<std::uint8_t>(bytes, kLasVersion + 1);
  if (major != 1 || minor > 4)
    throw InputError(file, fmt::format("is LAS {}.{}, at byte {}; versions 1.0 to 1.4 are read",
                                       major, minor, kLasVersion));
  const auto format = las_field<std::uint8_t>(bytes, kLasFormat);
  if ((format & kLazBits) != 0) {
    const std::string to = shell_quoted(file.stem().string() + ".las");
    const std::string from = shell_quoted(file.filename());
    throw InputError(file, fmt::format("is compressed (LAZ), which isn't read; convert it: `pdal "
                                       "translate {} {}`, or `laszip -i {} -o {}`",
                                       from, to, from, to));
  }
  if (format >= kLasRecords.size())
    throw InputError(file, fmt::format("has point format {}, at byte {}; formats 0 to {} are read",
                                       format, kLasFormat, kLasRecords.size() - 1));
  const auto size = las_field<std::uint16_t>(bytes, kLasRecordSize);
  if (size < kLasRecords[format])
    throw InputError(file, fmt::format("has records of {} bytes, at byte {}; those of point format "
                                       "{} have {} or more",
                                       size, kLasRecordSize, format, kLasRecords[format]));
  const auto points = las_field<std::uint32_t>(bytes, kLasPoints);
  if (points < kLasHead)
    throw InputError(file, fmt::format("has its points from byte {} on, by byte {}; the header "
                                       "ends at byte {}",
                                       points, kLasPoints, kLasHead));
}

}  // namespace

PointCloud read_las_points(const std::filesystem::path& file, std::string_view bytes) {
  check_las(file, bytes);
  Vec3 scale, offset;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    scale[i] = las_field<double>(bytes, kLasScale + k * sizeof(double));
    offset[i] = las_field<double>(bytes, kLasOffset + k * sizeof(double));
    if (!(scale[i] > 0) || !std::isfinite(scale[i]) || !std::isfinite(offset[i]))
      throw InputError(file,
                       fmt::format("has the scale {:g} and the offset {:g} of {}, at bytes "
                                   "{} and {}; they must be finite, the scale above 0",
                                   scale[i], offset[i], "xyz"[k], kLasScale + k * sizeof(double),
                                   kLasOffset + k * sizeof(double)));
  }
  const std::size_t at = las_field<std::uint32_t>(bytes, kLasPoints);
  const std::size_t size = las_field<std::uint16_t>(bytes, kLasRecordSize);
  require_fit(file, bytes, at, las_count(bytes), size, "points");
  const auto count = static_cast<std::size_t>(las_count(bytes));
  Axes axes;
  for (std::size_t k = 0; k < 3; ++k)
    axes[k] = {bytes.data() + at + k * sizeof(std::int32_t), size, NumberType::kI32};
  CloudBuilder cloud(/*zero_is_none=*/false);  // each record is a return
  cloud.expect(count);
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 p = point_at(axes, i, false).cwiseProduct(scale) + offset;
    if (!p.allFinite() || !cloud.add(p))
      throw InputError(
          file, fmt::format("the point at byte {} {}", at + i * size, CloudBuilder::too_far(p)));
  }
  return cloud.take();
}

}  // namespace soilvdb::inline v0::io
