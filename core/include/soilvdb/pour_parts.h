// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The parts of a pour over its duration.
#pragma once

#include <cstdint>

#include "soilvdb/earthmoving.h"

namespace soilvdb::inline v0 {

/// Parts of a pour, equal up to rounding and evenly spaced in time, independent of the updates. A
/// pour without duration has one part.
class PourParts {
 public:
  /// @param voxel_size_m of the ground; a part has some hundred voxels, within limits on the count
  PourParts(const Pour& pour, double voxel_size_m);

  std::int64_t count() const { return count_; }
  /// Time when part 1, 2, ... count() falls, s. The last part falls at the end; 0 is the beginning.
  double falls_s(std::int64_t part) const;

 private:
  double begin_s_, end_s_;
  std::int64_t count_ = 1;
};

}  // namespace soilvdb::inline v0
