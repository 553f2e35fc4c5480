// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Which columns of a motion are in use, by its header.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/io/csv.h"
#include "soilvdb/kinematics.h"

namespace soilvdb::inline v0::io {

/// Where the columns in use are. Values are kept in the order of `names`; names[0] is the time.
struct Columns {
  std::size_t count = 0;  ///< of the file
  std::vector<std::string> names;
  std::vector<std::size_t> fields;  ///< for each name, its field; kNone: 0 for all rows
  bool quaternion = false;
  std::vector<std::string> unused;  ///< names of the file's other columns
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
};

/// @param lines at the header @param chain of the machine, if it is given by joints
/// @throw InputError if columns are missing, twice there or contradict each other.
Columns read_columns(const RowPlace& lines, const std::vector<std::string_view>& header,
                     const std::optional<Chain>& chain);

/// "; did you mean 'pitch' by 'Pitch'?" where names that are wanted are there but for their case.
std::string other_case(const std::vector<std::string>& wanted,
                       const std::vector<std::string>& there);

}  // namespace soilvdb::inline v0::io
