// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The angles among a motion's numbers, and their unit.
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

/// Can the joint turn all the way round? Also true for limits of half a turn either way: sensors
/// wrap there, but joints do not stop there.
bool may_wrap(const Joint& joint);

/// An angle in the file's unit, "1.2" or "68.75".
std::string angle_text(double angle_rad, AngleUnit unit);
const char* unit_name(AngleUnit unit);

/// Converts a motion's angles to radians, and counts angles that can't be radians. A boom never
/// turns more than once, but in degrees it is hardly ever below 6.3.
class Angles {
 public:
  Angles() = default;
  /// @param names of the values of a row: time, then joints or x, y, z and a rotation
  Angles(const std::vector<std::string>& names, const std::optional<Chain>& chain, AngleUnit unit);

  /// @param v values of a row, good or bad, in the file's units
  void row(std::vector<double>& v, long line);

  /// @throw InputError if at least half of the rows have an angle beyond a turn that cannot go
  ///        there.
  void check(const std::filesystem::path& file) const;
  /// Adds a warning about roll, pitch and yaw of poses beyond a turn.
  void warn(const RowPlace& place, std::vector<std::string>& warnings) const;

 private:
  struct Count {
    std::int64_t rows = 0;
    long first = 0;
    std::string name = {};  ///< name of that angle
    double angle_rad = 0;
  };
  struct Angle {
    std::size_t at = 0;  ///< index in a row
    std::string name = {};
    bool goes_round = false;
    bool of_joint = false;
  };
  std::vector<Angle> angles_;
  AngleUnit unit_ = AngleUnit::kRadians;
  bool joints_ = false;
  std::int64_t rows_ = 0;
  Count beyond_;      ///< a turn: angles of poses
  Count impossible_;  ///< beyond a turn: angles that cannot go there
};

}  // namespace soilvdb::inline v0::io
