// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Points, rotations and poses of all stages. Metres, radians, seconds; right-handed, z up.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <stdexcept>

namespace soilvdb::inline v0 {

using Vec2 = Eigen::Vector2d;
using Vec3 = Eigen::Vector3d;
using Coord2 = Eigen::Vector2i;
using Coord3 = Eigen::Vector3i;

/// A rigid transform; a_from_b maps coordinates in frame b to frame a.
struct Pose {
  Vec3 position = Vec3::Zero();                                  ///< origin of b in a, m
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< axes of b in a, unit

  Vec3 operator*(const Vec3& p) const { return rotation * p + position; }
  Pose operator*(const Pose& o) const { return {*this * o.position, rotation * o.rotation}; }
  Pose inverse() const {
    const Eigen::Quaterniond r = rotation.conjugate();
    return {-(r * position), r};
  }
};

/// The numbers of a pose in a row: x, y, z, qx, qy, qz, qw.
inline constexpr std::size_t kPoseNumbers = 7;
inline std::array<double, kPoseNumbers> row_of(const Pose& pose) {
  const Vec3& p = pose.position;
  const auto& q = pose.rotation.coeffs();
  return {p[0], p[1], p[2], q[0], q[1], q[2], q[3]};
}
/// The pose of seven numbers as in row_of().
inline Pose pose_of(const double* v) {
  return {{v[0], v[1], v[2]}, Eigen::Quaterniond(v[6], v[3], v[4], v[5])};
}

/// Pose at fraction `s` in [0, 1] of the way from `a` to `b`: position linear, rotation slerp
/// along the shorter arc.
inline Pose interpolate(const Pose& a, const Pose& b, double s) {
  return {a.position + s * (b.position - a.position), a.rotation.slerp(s, b.rotation)};
}

/// Rotation by roll about x, then pitch about y, then yaw about z, all fixed axes (REP-103, URDF).
inline Eigen::Quaterniond from_rpy(double roll, double pitch, double yaw) {
  return Eigen::AngleAxisd(yaw, Vec3::UnitZ()) * Eigen::AngleAxisd(pitch, Vec3::UnitY()) *
         Eigen::AngleAxisd(roll, Vec3::UnitX());
}

/// A bucket reached ground for which the terrain has no height.
struct NoGroundError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace soilvdb::inline v0
