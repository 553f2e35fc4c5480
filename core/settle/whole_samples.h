// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Volumes and heights as whole samples and cells.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace soilvdb::inline v0 {

/// Splits samples among volumes, none made or lost by rounding.
class WholeSamples {
 public:
  explicit WholeSamples(double per_volume) : per_volume_(per_volume) {}
  std::int64_t next(double volume) {
    sum_ += volume * per_volume_;
    const std::int64_t before = given_;
    given_ = std::max(before, static_cast<std::int64_t>(std::llround(sum_)));
    return given_ - before;
  }

 private:
  double per_volume_, sum_ = 0;
  std::int64_t given_ = 0;
};

}  // namespace soilvdb::inline v0
