// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/gnss.h"

#include <stdexcept>

namespace soilvdb::inline v0 {
namespace {

/// Sine of the smallest angle between the line through the antennas and what points up.
constexpr double kLeastSine = 0.1;

/// Antennas at one place tell no direction, m.
constexpr double kLeastLine_m = 0.1;

/// Axes along a line, and as close to `up` as can be.
Eigen::Matrix3d axes_along(const Vec3& line, const Vec3& up) {
  if (!(line.norm() >= kLeastLine_m))
    throw std::invalid_argument("the antennas are at one place, and tell no heading");
  const Vec3 along = line.normalized();
  const Vec3 across = up - along.dot(up) * along;
  if (!(across.norm() >= kLeastSine))
    throw std::invalid_argument("the line through the antennas is upright, and tells no heading");
  Eigen::Matrix3d axes;
  axes << along, across.normalized(), along.cross(across.normalized());
  return axes;
}

}  // namespace

Pose pose_of_antennas(std::span<const Vec3> mounted_m, std::span<const Vec3> places_m,
                      const Vec3& up) {
  Pose pose;
  pose.rotation = Eigen::Matrix3d(axes_along(places_m[1] - places_m[0], Vec3::UnitZ()) *
                                  axes_along(mounted_m[1] - mounted_m[0], up).transpose());
  pose.rotation.normalize();
  pose.position =
      (places_m[0] + places_m[1]) / 2 - pose.rotation * ((mounted_m[0] + mounted_m[1]) / 2);
  return pose;
}

}  // namespace soilvdb::inline v0
