// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The angles of a motion: which of its numbers they are, and what they are in.
#pragma once

#include <cstdint>
#include <filesystem>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/motion_csv.h"
#include "soilvdb/kinematics.h"

namespace soilvdb::inline v0::io {

inline constexpr double kTurn = 2 * std::numbers::pi;

/// Can the joint's angle go all the way round? So it is for limits of half a turn either way, too:
/// they are where a sensor wraps, not where the joint stops.
bool may_wrap(const Joint& joint);

/// An angle as the file has it, "1.2" or "68.75", and what that is in.
std::string angle_text(double angle_rad, AngleUnit unit);
const char* unit_name(AngleUnit unit);

/// Makes radians of a motion's angles, and counts those that can't be radians: no boom turns more
/// than once, but at 6.3 degrees it hardly ever is.
class Angles {
 public:
  Angles() = default;
  /// @param names of the values of a row: time, then joints or x, y, z and a rotation
  Angles(const std::vector<std::string>& names, const std::optional<Chain>& chain, AngleUnit unit);

  /// @param v values of a row, good or not, as the file has them
  void row(std::vector<double>& v, long line);

  /// @throw InputError if half the rows or more have an angle beyond a turn where none goes there.
  void check(const std::filesystem::path& file) const;
  /// Warns of roll, pitch and yaw beyond a turn, whichever.
  void warn(const RowPlace& place, std::vector<std::string>& warnings) const;

 private:
  struct Count {
    std::int64_t rows = 0;
    long first = 0;
    std::string name = {};  ///< of the angle there
    double angle_rad = 0;
  };
  struct Angle {
    std::size_t at = 0;  ///< in a row
    std::string name = {};
    bool goes_round = false;
  };
  std::vector<Angle> angles_;
  AngleUnit unit_ = AngleUnit::kRadians;
  bool joints_ = false;
  std::int64_t rows_ = 0;
  Count beyond_, impossible_;  ///< a turn; a turn where none goes there
};

}  // namespace soilvdb::inline v0::io
