// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Motions of buckets as CSV: a header, then one row per time, by poses or by joints.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/motion.h"
#include "io/error.h"

namespace soilvdb::io {

struct MotionInput {
  Motion motion;
  std::vector<std::string> warnings;  ///< unused columns, joints beyond their limits
};

/// Reads `time` (s, strictly increasing) and, without a chain, x,y,z (m) with roll,pitch,yaw (rad,
/// missing ones are 0) or qx,qy,qz,qw: the bucket frame in the world; with a chain, a column for
/// each of its movable joints (rad or m).
///
/// UTF-8 with or without a byte order mark, LF or CR LF line ends, spaces around commas, quoted
/// fields, blank lines at the end. Columns it has no use for are skipped unread, with one warning.
/// @throw InputError naming file, line, what is wrong and what would be right.
MotionInput read_motion(const std::filesystem::path& file, const std::optional<Chain>& chain);

}  // namespace soilvdb::io
