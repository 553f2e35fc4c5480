// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The rows of a motion as plain numbers, for the journal.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "soilvdb/motion.h"

namespace soilvdb::inline v0::io {

inline bool same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

/// The numbers of a pose in a row: x, y, z, qx, qy, qz, qw.
inline std::array<double, 7> row_of(const Pose& pose) {
  const Vec3& p = pose.position;
  const auto& q = pose.rotation.coeffs();
  return {p[0], p[1], p[2], q[0], q[1], q[2], q[3]};
}
/// The pose of seven numbers as in row_of().
inline Pose pose_of(const double* v) {
  return {{v[0], v[1], v[2]}, Eigen::Quaterniond(v[6], v[3], v[4], v[5])};
}

struct MotionRows {
  bool joints = false;      ///< else poses as in row_of()
  std::size_t columns = 0;  ///< values per row
  std::vector<double> times_s, values;
};

/// The rows of a motion that determine its poses in [begin_s, end_s].
MotionRows rows_between(const Motion& motion, double begin_s, double end_s);

/// A motion of these rows; between the same times it has the same poses, bit by bit.
/// @throw std::invalid_argument if the rows are no motion of this chain.
Motion motion_of(const MotionRows& rows, const Chain& chain);

}  // namespace soilvdb::inline v0::io
