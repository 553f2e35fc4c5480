// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The rows of a motion as plain numbers, for the journal.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "soilvdb/motion.h"

namespace soilvdb::inline v0::io {

inline bool same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

struct MotionRows {
  bool joints = false;      ///< configurations of a chain; else poses as in row_of()
  std::size_t columns = 0;  ///< values per row
  std::vector<double> times_s, values;
};

/// The rows of a motion that determine its poses in [begin_s, end_s].
MotionRows rows_between(const Motion& motion, double begin_s, double end_s);

/// A motion of these rows; between the same times it has the same poses, bit by bit.
/// @throw std::invalid_argument if the rows are no motion of this chain.
Motion motion_of(const MotionRows& rows, const Chain& chain);

}  // namespace soilvdb::inline v0::io
