// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Earlier fits of cells, for ground that is meshed repeatedly.
#pragma once

#include <cstdint>
#include <vector>

#include "core/cell/cell_plane.h"
#include "core/cell/crease.h"

namespace soilvdb::inline v0 {

/// Fits and creases of cells by their arguments: the place, the samples around it and, for creases,
/// the candidate planes.
///
/// Guarantees: a cached result equals a new one. Memory is 3 MB; a cell replaces an earlier one
/// with the same slot. Caveat: keys are 63 bits of a hash. For one thread at a time.
class FitCache {
 public:
  FitCache();
  PlaneFit fit(const CellGrid& grid, int id);
  CellModel crease(const CellGrid& grid, int id, const Candidates& candidates);

 private:
  template <typename T>
  struct Entry {
    std::uint64_t key = 0;  // 0: empty
    T value;
  };
  std::vector<Entry<PlaneFit>> fits_;
  std::vector<Entry<CellModel>> creases_;
};

}  // namespace soilvdb::inline v0
