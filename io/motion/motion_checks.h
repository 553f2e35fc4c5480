// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Checks of a motion's rows, alone and against the row before.
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

// All functions throw LineError with the place of `lines`.

/// The number in a field of column `name`, if a sensor could have sent it.
double row_number(const RowPlace& lines, const std::string& name, std::string_view field);
/// The time of a row, s: a number, or a date_time_s().
double row_time(const RowPlace& lines, std::string_view field);
/// The same check for a number that is not text.
void check_number(const RowPlace& lines, const std::string& name, double value);

/// @param v x, y, z and roll, pitch, yaw or qx, qy, qz, qw @param prefix of these names
Pose row_pose(const RowPlace& lines, std::span<const double> v, bool quaternion,
              const char* prefix = "");

/// Refuses a joint clearly beyond its limits. @param row the time, then a configuration, in radians
/// @param unit of the file
void check_limits(const RowPlace& lines, const Chain& chain, const std::vector<double>& row,
                  AngleUnit unit);

/// Refuses a pose that no bucket reaches in that time, and joints likewise.
void check_poses(const RowPlace& lines, const Pose& before, const Pose& pose, double after_s);
/// @param before the time, then a configuration; so is `row`
void check_joints(const RowPlace& lines, const Chain& chain, const std::vector<double>& before,
                  const std::vector<double>& row);

/// Are two rows, or parts of them, equal but for rounding?
bool same_values(std::span<const double> a, std::span<const double> b);

/// Unwraps joints past whole turns. @param before as above @param row in: the file's values @param
/// turns whole turns of each joint by wrapping; in: before this row, out: with it
void go_on_past_turns(const Chain& chain, const std::vector<double>& before,
                      std::vector<double>& row, std::vector<int>& turns);

/// The same checks for single states of a machine, in radians: a message if the state is
/// impossible, else empty.
/// @param values a configuration of the chain
std::string state_fault(const Chain& chain, std::span<const double> values);
/// @param before the configuration, that many seconds ago
std::string state_fault(const Chain& chain, std::span<const double> before,
                        std::span<const double> values, double after_s);
std::string state_fault(const Pose& before, const Pose& pose, double after_s);

/// Counts rows with a movable joint beyond its limits, or with a turn that may be a wrap.
class JointLimits {
 public:
  explicit JointLimits(const Chain& chain);
  /// @param v the time, then the joints @param turns as in go_on_past_turns()
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

/// Gaps of a recording during which the machine moved in an unknown way.
class Gaps {
 public:
  /// @param most_s longest gap that is no finding; empty: any gap
  explicit Gaps(std::optional<double> most_s) : most_s_(most_s) {}

  /// @param place of the row after a gap @param moved m or rad, the larger number
  void row(const RowPlace& place, double gap_s, double moved);
  void warn(std::vector<std::string>& warnings) const;

 private:
  std::optional<double> most_s_;
  long count_ = 0;
  double longest_s_ = 0;
  std::string longest_;
};

}  // namespace soilvdb::inline v0::io
