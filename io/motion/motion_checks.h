// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a row of a motion may say, by itself and after the row before it.
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/io/csv.h"
#include "soilvdb/io/motion_csv.h"
#include "soilvdb/kinematics.h"

namespace soilvdb::inline v0::io {

// All throw LineError naming the line that `lines` is at.

/// The number in a field of column `name`, one that a sensor could have sent.
double row_number(const RowPlace& lines, const std::string& name, std::string_view field);
/// The same of a number that is no text.
void check_number(const RowPlace& lines, const std::string& name, double value);

/// @param v time, x, y, z and roll, pitch, yaw or qx, qy, qz, qw
Pose row_pose(const RowPlace& lines, const std::vector<double>& v, bool quaternion);

/// Refuses a joint's value clearly beyond where it stops. @param row the time, then the joints
/// @param unit of the file; values are in radians
void check_limits(const RowPlace& lines, const Chain& chain, const std::vector<double>& row,
                  AngleUnit unit);

/// Refuses a pose that no bucket reaches in that time, or a joint's value that no joint does.
void check_poses(const RowPlace& lines, const Pose& before, const Pose& pose, double after_s);
/// @param before the time, then the joints; so is `row`
void check_joints(const RowPlace& lines, const Chain& chain, const std::vector<double>& before,
                  const std::vector<double>& row);

/// Do two rows, or parts of them, say the same but for rounding?
bool same_values(std::span<const double> a, std::span<const double> b);

/// Has joints that wrap go on past a whole turn. @param before as above @param row the same as its
/// file has it @param turns that each joint has made by wrapping before; then, with this row
void go_on_past_turns(const Chain& chain, const std::vector<double>& before,
                      std::vector<double>& row, std::vector<int>& turns);

/// The same of states of a machine as they come: what can't be and what would be right, in radians;
/// empty if it can. @param joints rad or m, one for each movable joint
std::string state_fault(const Chain& chain, std::span<const double> joints);
/// @param before its joints that many seconds ago
std::string state_fault(const Chain& chain, std::span<const double> before,
                        std::span<const double> joints, double after_s);
std::string state_fault(const Pose& before, const Pose& pose, double after_s);

/// Rows in which each movable joint is beyond its limits, or turns so far that it may have wrapped.
class JointLimits {
 public:
  explicit JointLimits(const Chain& chain);
  /// @param v the time, then the joints @param turns as go_on_past_turns() has them
  void row(const std::vector<double>& v, const std::vector<int>& turns, long line);
  void warn(const RowPlace& place, std::vector<std::string>& warnings) const;

 private:
  struct Count {
    Joint joint;
    long rows = 0, first = 0;
    double before = std::numeric_limits<double>::quiet_NaN();
    long turns = 0, first_turn = 0;
  };
  std::vector<Count> joints_;
};

/// Gaps of a recording across which its machine moved: nobody knows how.
class Gaps {
 public:
  /// @param most_s which go without saying; nothing: any do
  explicit Gaps(std::optional<double> most_s) : most_s_(most_s) {}

  /// @param place of the row after a gap @param moved m or rad, whichever is more
  void row(const RowPlace& place, double gap_s, double moved);
  void warn(std::vector<std::string>& warnings) const;

 private:
  std::optional<double> most_s_;
  long count_ = 0;
  double longest_s_ = 0;
  std::string longest_;
};

}  // namespace soilvdb::inline v0::io
