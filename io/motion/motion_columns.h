// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The used columns of a motion, by its header.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/io/csv.h"
#include "soilvdb/kinematics.h"

namespace soilvdb::inline v0::io {

/// Positions of the used columns. Values have the order of `names`; names[0] is the time.
struct Columns {
  std::size_t count = 0;  ///< of the file
  std::vector<std::string> names;
  std::vector<std::size_t> fields;       ///< field number of each name; kNone: 0 in all rows
  bool quaternion = false;               ///< of the pose, or of the base
  std::optional<std::size_t> base = {};  ///< of `names`: first of the base's, after the joints'
  std::vector<std::string> unused;       ///< names of the file's other columns
  std::vector<std::string> absent = {};  ///< the base's, where the file has none of them
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
};

/// @param lines at the header @param chain of a machine that moves by joints
/// @throw InputError if columns are missing, repeated or contradictory.
Columns read_columns(const RowPlace& lines, const std::vector<std::string_view>& header,
                     const std::optional<Chain>& chain);

/// "; did you mean 'pitch' by 'Pitch'?" for wanted names that differ only in their case.
std::string other_case(const std::vector<std::string>& wanted,
                       const std::vector<std::string>& there);

}  // namespace soilvdb::inline v0::io
