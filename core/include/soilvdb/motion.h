// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A bucket's motion: rows of poses or joint values in time, interpolated between rows.
#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/kinematics.h"

namespace soilvdb::inline v0 {

/// A motion over [begin_s, end_s]. Joint values and positions are linear between rows; rotations,
/// also that of a machine's base, use slerp. Times strictly increase; there is at least one row.
class Motion {
 public:
  /// @throw std::invalid_argument if the sizes differ or are zero, times do not strictly increase,
  ///        a number is not finite or exceeds 1e9, a rotation is not unit, or a joint moves more
  ///        than 1000 rad or m between rows
  Motion(std::vector<double> times_s, std::vector<Pose> world_from_bucket);
  /// @param joint_values a configuration of the chain for each row, all with the root's pose or
  ///        all without
  Motion(std::vector<double> times_s, std::vector<double> joint_values, Chain chain);

  const std::vector<double>& times_s() const { return times_s_; }
  double begin_s() const { return times_s_.front(); }
  double end_s() const { return times_s_.back(); }

  /// Pose at times_s()[i].
  Pose row(std::size_t i) const { return between(i, i, times_s_[i]); }

  /// Number of parts from row i - 1 to row i in each of which no joint moves more than 1 rad or m,
  /// and the root turns no more than 1 rad.
  std::size_t row_pieces(std::size_t i) const;
  /// The rows as given: poses, or configurations and their chain.
  std::span<const Pose> poses() const { return poses_; }
  std::span<const double> joint_values() const { return joint_values_; }
  std::span<const double> configuration(std::size_t i) const {  ///< of row i
    return std::span(joint_values_).subspan(i * columns(), columns());
  }
  const Chain& chain() const { return chain_; }

  /// Pose at `time_s`, clamped to [begin_s, end_s].
  Pose pose(double time_s) const;
  /// The same of joints; empty for a motion of poses.
  std::vector<double> joint_values(double time_s) const;

  /// A motion with the fewest rows that keep each corner of the bucket within `tolerance_m` of its
  /// position at each original row's time.
  Motion simplified(const Bucket& bucket, double tolerance_m) const;

  /// The motion from `t0` to `t1` in segments: the start pose, then for each segment the pose at
  /// half its time and its end pose. In a segment no corner moves more than `stride_m`. Over the
  /// whole bucket, a point fixed in the world deviates at most `bend_m` from a straight line in the
  /// bucket frame. Segments end at the rows between.
  std::vector<Pose> trace(double t0, double t1, const Bucket& bucket, double bend_m,
                          double stride_m) const;

 private:
  /// Numbers in a row of joint_values_.
  std::size_t columns() const { return joint_values_.size() / times_s_.size(); }
  std::pair<std::size_t, std::size_t> rows_around(double time_s) const;
  double share_of(std::size_t i, std::size_t j, double time_s) const;
  Pose between(std::size_t i, std::size_t j, double time_s) const;

  std::vector<double> times_s_;
  std::vector<Pose> poses_;
  std::vector<double> joint_values_;
  Chain chain_;
};

/// Whether a pose has finite numbers within 1e9 m and a unit rotation.
bool is_valid(const Pose& pose);
/// Why a pose is invalid, with the value and the allowed values; empty if it is valid.
std::string validation_error(const Pose& pose);
/// Why a position is invalid; each coordinate must be within `farthest_m` of that of `middle_m`.
std::string validation_error(const Vec3& position_m, const Vec3& middle_m, double farthest_m);

/// Motion::trace() for interpolate() between two poses; appends to `out`.
void trace(const Pose& a, const Pose& b, const Bucket& bucket, double tolerance_m, double stride_m,
           std::vector<Pose>& out);

}  // namespace soilvdb::inline v0
