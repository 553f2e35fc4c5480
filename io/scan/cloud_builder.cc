// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scan/cloud_builder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "core/constants.h"
#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

template <typename T>
double number_as(const char* at, bool swap) {
  std::array<char, sizeof(T)> bytes;
  std::memcpy(bytes.data(), at, sizeof(T));
  if (swap) std::reverse(bytes.begin(), bytes.end());
  T value;
  std::memcpy(&value, bytes.data(), sizeof(T));
  return static_cast<double>(value);
}

}  // namespace

std::size_t PointCloud::leave_out_far() {
  return std::erase_if(points_m, [](const Vec3& p) { return p.norm() > kMostScanRangeM; });
}

double number_at(const char* at, NumberType type, bool swap) {
  constexpr auto kNumbers =
      std::array{&number_as<std::int8_t>,   &number_as<std::uint8_t>,  &number_as<std::int16_t>,
                 &number_as<std::uint16_t>, &number_as<std::int32_t>,  &number_as<std::uint32_t>,
                 &number_as<std::int64_t>,  &number_as<std::uint64_t>, &number_as<float>,
                 &number_as<double>};  // in the order of NumberType
  return kNumbers[static_cast<std::size_t>(type)](at, swap);
}

Vec3 point_at(const Axes& axes, std::size_t index, bool swap) {
  Vec3 p;
  for (std::size_t k = 0; k < axes.size(); ++k)
    p[static_cast<Eigen::Index>(k)] =
        number_at(axes[k].at + index * axes[k].stride, axes[k].type, swap);
  return p;
}

std::optional<std::size_t> CloudBuilder::add(const Axes& axes, std::size_t count, bool swap) {
  for (std::size_t i = 0; i < count; ++i)
    if (!add(point_at(axes, i, swap))) return i;
  return {};
}

bool CloudBuilder::is_too_far(const Vec3& p) { return !(p.cwiseAbs().maxCoeff() <= kMaxNumber); }

std::string CloudBuilder::too_far(const Vec3& p) {
  return fmt::format("is at ({:g}, {:g}, {:g}); coordinates must be metres within {:g}", p.x(),
                     p.y(), p.z(), kMaxNumber);
}

}  // namespace soilvdb::inline v0::io
