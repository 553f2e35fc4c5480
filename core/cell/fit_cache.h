// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the cells of a surface came to before, for ground that is meshed again and again.
#pragma once

#include <cstdint>
#include <vector>

#include "core/cell/cell_plane.h"
#include "core/cell/crease.h"

namespace soilvdb::inline v0 {

/// Fits and creases of cells by what they are functions of: the place, the samples around it and,
/// of creases, the planes that are tried.
///
/// Guarantees: what comes out is what would be made anew. Memory is 3 MB; of two cells that want
/// the same room the later one has it. Caveat: cells are told apart by 63 bits of a hash.
/// For one thread at a time.
class FitCache {
 public:
  FitCache();
  PlaneFit fit(const CellGrid& grid, int id);
  CellModel crease(const CellGrid& grid, int id, const Candidates& candidates);

 private:
  template <typename T>
  struct Entry {
    std::uint64_t key = 0;  // 0: of no cell
    T value;
  };
  std::vector<Entry<PlaneFit>> fits_;
  std::vector<Entry<CellModel>> creases_;
};

}  // namespace soilvdb::inline v0
