// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A bucket's motion: rows in time, by poses or by joints, and the pose at any time between them.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/kinematics.h"

namespace soilvdb::inline v0 {

/// A motion over [begin_s, end_s]. Between rows joints are linear, positions linear and rotations
/// slerp. Times strictly increase; at least one row.
class Motion {
 public:
  /// @throw std::invalid_argument if the sizes differ or are zero, times don't strictly increase, a
  ///        number is not finite or beyond 1e9, a rotation not unit, or a joint goes on by more
  ///        than 1000 rad or m in one row.
  Motion(std::vector<double> times_s, std::vector<Pose> world_from_bucket);
  /// @param joint_values row-major, times_s.size() x chain.movable().size()
  Motion(std::vector<double> times_s, std::vector<double> joint_values, Chain chain);

  const std::vector<double>& times_s() const { return times_s_; }
  double begin_s() const { return times_s_.front(); }
  double end_s() const { return times_s_.back(); }

  /// Pose at times_s()[i].
  Pose row(std::size_t i) const { return between(i, i, times_s_[i]); }

  /// Pieces of the way from row i - 1 to row i in which no joint moves more than a radian or metre.
  std::size_t row_pieces(std::size_t i) const;
  /// Its rows as given: poses, or else joint values and the chain they move.
  std::span<const Pose> poses() const { return poses_; }
  std::span<const double> joint_values() const { return joint_values_; }
  const Chain& chain() const { return chain_; }

  /// Pose at `time_s`, clamped to [begin_s, end_s].
  Pose pose(double time_s) const;

  /// The same motion with as few of its rows as keep every corner of the bucket within
  /// `tolerance_m` of where it was at each row's time.
  Motion simplified(const Bucket& bucket, double tolerance_m) const;

  /// The motion from `t0` to `t1` in segments: the pose where it starts, then for each segment the
  /// pose half-way in time and the one at its end. In a segment no corner moves more than
  /// `stride_m` and a point fixed in the world leaves the straight way in the bucket frame by no
  /// more than `bend_m`, over the whole bucket. Every row between is respected.
  std::vector<Pose> trace(double t0, double t1, const Bucket& bucket, double bend_m,
                          double stride_m) const;

 private:
  std::size_t joints() const { return joint_values_.size() / times_s_.size(); }
  Pose between(std::size_t i, std::size_t j, double time_s) const;

  std::vector<double> times_s_;
  std::vector<Pose> poses_;
  std::vector<double> joint_values_;
  Chain chain_;
};

/// Is this a pose, of finite numbers within 1e9 m and with a unit rotation?
bool is_valid(const Pose& pose);
/// Why it isn't, with the value and what would be right; empty if it is.
std::string validation_error(const Pose& pose);
/// The same for a place, of which no coordinate is to be farther than that from a middle's.
std::string validation_error(const Vec3& position_m, const Vec3& middle_m, double farthest_m);

/// trace() for a straight interpolation between two poses.
void trace(const Pose& a, const Pose& b, const Bucket& bucket, double tolerance_m, double stride_m,
           std::vector<Pose>& out);

}  // namespace soilvdb::inline v0
