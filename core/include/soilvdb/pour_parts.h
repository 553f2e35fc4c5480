// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How a pour is spread over its time.
#pragma once

#include <cstdint>

#include "soilvdb/earthmoving.h"

namespace soilvdb::inline v0 {

/// The parts in which a pour comes down, equal but for rounding and evenly over its time: the same
/// whatever the updates are. A pour of no duration has one.
class PourParts {
 public:
  /// @param voxel_size_m of the ground; parts are of so many voxels, some hundred, or fewer
  PourParts(const Pour& pour, double voxel_size_m);

  std::int64_t count() const { return count_; }
  /// When part 1, 2, ... count() falls, s; the last one at the end. 0: the beginning
  double falls_s(std::int64_t part) const;

 private:
  double begin_s_, end_s_;
  std::int64_t count_ = 1;
};

}  // namespace soilvdb::inline v0
