// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scan/scan_messages.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "io/file/text.h"
#include "io/motion/mcap_messages.h"
#include "io/scan/cloud_builder.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::uint8_t kFloat32 = 7, kFloat64 = 8;  // datatypes of sensor_msgs/PointField
constexpr double kMmPerM = 1000;

ScanHeader next_scan_header(CdrReader& cdr) {
  ScanHeader header;
  header.stamp_ns = read_stamp(cdr);
  header.frame_id = cdr.text();
  return header;
}

/// Checks that rows of pixels or points fit into the message's data. @return bytes between rows
std::size_t checked_rows(std::uint64_t rows, std::uint64_t columns, std::uint64_t bytes,
                         std::uint64_t row_bytes, std::size_t there) {
  const std::uint64_t row = columns * bytes;
  if (rows <= 1) row_bytes = std::max(row_bytes, row);  // some drivers leave it at 0
  if (row_bytes < row)
    throw ScanFault(fmt::format("has rows of {} bytes; {} columns of {} bytes need {}", row_bytes,
                                columns, bytes, row));
  if (rows > 0 &&
      (row > there || (rows - 1) > (there - row) / std::max<std::uint64_t>(row_bytes, 1)))
    throw ScanFault(
        fmt::format("has {} bytes of data; {} rows of {} bytes need more", there, rows, row_bytes));
  return static_cast<std::size_t>(row_bytes);
}

/// The three coordinates of a point from the list of fields.
struct CloudFields {
  std::array<std::uint32_t, 3> offsets{};
  std::array<NumberType, 3> types{};
};

CloudFields read_cloud_fields(CdrReader& cdr) {
  constexpr std::size_t kLeastBytes = 4 + 4 + 1 + 4;
  CloudFields fields;
  std::array<bool, 3> found{};
  for (std::uint32_t left = cdr.count(kLeastBytes); left > 0; --left) {
    const std::string_view name = cdr.text();
    const auto offset = cdr.number<std::uint32_t>();
    const auto datatype = cdr.number<std::uint8_t>();
    cdr.number<std::uint32_t>();  // count
    if (name.size() != 1 || name[0] < 'x' || name[0] > 'z') continue;
    const auto k = static_cast<std::size_t>(name[0] - 'x');
    if (found[k]) throw ScanFault(fmt::format("has two fields '{}'", name));
    if (datatype != kFloat32 && datatype != kFloat64)
      throw ScanFault(
          fmt::format("has the field '{}' of datatype {}; it must be FLOAT32, {}, or "
                      "FLOAT64, {}",
                      name, datatype, kFloat32, kFloat64));
    found[k] = true;
    fields.offsets[k] = offset;
    fields.types[k] = datatype == kFloat32 ? NumberType::kF32 : NumberType::kF64;
  }
  for (std::size_t k = 0; k < found.size(); ++k)
    if (!found[k]) throw ScanFault(fmt::format("has no field '{}'", "xyz"[k]));
  return fields;
}

}  // namespace

ScanHeader read_scan_header(std::string_view bytes) {
  CdrReader cdr(bytes);
  return next_scan_header(cdr);
}

CameraModel read_camera_info(std::string_view bytes) {
  CdrReader cdr(bytes);
  next_scan_header(cdr);
  CameraModel camera;
  camera.height = cdr.number<std::uint32_t>();
  camera.width = cdr.number<std::uint32_t>();
  cdr.text();  // the distortion's model
  bool distorted = false;
  for (std::uint32_t left = cdr.count(sizeof(double)); left > 0; --left)
    distorted = cdr.number<double>() != 0 || distorted;
  std::array<double, 9> k{};
  for (double& v : k) v = cdr.number<double>();
  for (int i = 0; i < 9 + 12; ++i) cdr.number<double>();  // R, P
  const auto binning_x = cdr.number<std::uint32_t>(), binning_y = cdr.number<std::uint32_t>();
  const auto from_x = cdr.number<std::uint32_t>(), from_y = cdr.number<std::uint32_t>();
  camera.fx = k[0];
  camera.fy = k[4];
  camera.cx = k[2];
  camera.cy = k[5];
  if (distorted)
    throw ScanFault(
        "has a distortion, D, other than 0; use the topic of rectified depths, whose D "
        "is 0");
  if (!(camera.fx > 0 && camera.fx <= kMaxNumber && camera.fy > 0 && camera.fy <= kMaxNumber &&
        std::abs(camera.cx) <= kMaxNumber && std::abs(camera.cy) <= kMaxNumber) ||
      k[1] != 0 || k[3] != 0)
    throw ScanFault(
        fmt::format("has no K of a pinhole camera, fx 0 cx 0 fy cy 0 0 1, but {:g} {:g} "
                    "{:g} {:g} {:g} {:g}",
                    k[0], k[1], k[2], k[3], k[4], k[5]));
  if (binning_x > 1 || binning_y > 1 || from_x > 0 || from_y > 0)
    throw ScanFault("has a binning or a region of interest; only whole images are read");
  return camera;
}

PointCloud read_point_cloud2(std::string_view bytes, std::size_t most) {
  CdrReader cdr(bytes);
  next_scan_header(cdr);
  const auto height = cdr.number<std::uint32_t>(), width = cdr.number<std::uint32_t>();
  const CloudFields fields = read_cloud_fields(cdr);
  const bool big_endian = cdr.number<std::uint8_t>() != 0;
  const auto step = cdr.number<std::uint32_t>(), row_step = cdr.number<std::uint32_t>();
  const std::string_view data = cdr.bytes();
  for (std::size_t k = 0; k < 3; ++k)
    if (std::uint64_t{fields.offsets[k]} + size_of(fields.types[k]) > step)
      throw ScanFault(fmt::format("has the field '{}' at byte {} of points of {} bytes", "xyz"[k],
                                  fields.offsets[k], step));
  const std::size_t row = checked_rows(height, width, step, row_step, data.size());
  CloudBuilder cloud;
  const std::size_t rows = width == 0 ? 0 : height;
  if (rows > 0 && width > most / rows)
    throw ScanFault(fmt::format("has {} x {} points; there may be {}", width, height, most));
  cloud.expect(rows * width);
  for (std::size_t v = 0; v < rows; ++v) {
    Axes axes;
    for (std::size_t k = 0; k < 3; ++k)
      axes[k] = {data.data() + v * row + fields.offsets[k], step, fields.types[k]};
    if (const auto far = cloud.add(axes, width, big_endian))
      throw ScanFault(fmt::format("has the point {} that {}", v * width + *far + 1,
                                  CloudBuilder::too_far(point_at(axes, *far, big_endian))));
  }
  return cloud.take();
}

PointCloud read_depth_image(std::string_view bytes, const CameraModel& camera) {
  CdrReader cdr(bytes);
  next_scan_header(cdr);
  const auto height = cdr.number<std::uint32_t>(), width = cdr.number<std::uint32_t>();
  const std::string_view encoding = cdr.text();
  const bool big_endian = cdr.number<std::uint8_t>() != 0;
  const auto step = cdr.number<std::uint32_t>();
  const std::string_view data = cdr.bytes();
  if (encoding != "16UC1" && encoding != "32FC1")
    throw ScanFault(fmt::format("is an image of '{}'; depths are 16UC1, in mm, or 32FC1, in m",
                                printable(encoding)));
  if (width != camera.width || height != camera.height)
    throw ScanFault(fmt::format("has {} x {} pixels, and its CameraInfo {} x {}", width, height,
                                camera.width, camera.height));
  const NumberType type = encoding == "16UC1" ? NumberType::kU16 : NumberType::kF32;
  const double unit = type == NumberType::kU16 ? kMmPerM : 1;
  const std::size_t row = checked_rows(height, width, size_of(type), step, data.size());
  CloudBuilder cloud;
  const std::size_t rows = width == 0 ? 0 : height;
  cloud.expect(rows * width);
  for (std::size_t v = 0; v < rows; ++v) {
    for (std::size_t u = 0; u < width; ++u) {
      const double depth =
          number_at(data.data() + v * row + u * size_of(type), type, big_endian) / unit;
      const Vec3 p = camera.point(u, v, depth > 0 ? depth : 0);
      if (!cloud.add(p))
        throw ScanFault(
            fmt::format("has the pixel ({}, {}) that {}", u, v, CloudBuilder::too_far(p)));
    }
  }
  return cloud.take();
}

}  // namespace soilvdb::inline v0::io
