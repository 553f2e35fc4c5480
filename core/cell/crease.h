// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Cells in which planes meet: which of the planes seen nearby, joined how, explain the samples.
#pragma once

#include <span>

#include "core/cell/cell_model.h"

namespace soilvdb::inline v0 {

/// The planes that may meet in a cell, all seen from it, the likeliest first, no two alike.
class Candidates {
 public:
  /// Adds a plane unless it is far from the cell or one like it is there, or there is no room.
  void add(const CellPlane& plane);
  std::span<const CellPlane> planes() const { return {planes_, static_cast<std::size_t>(size_)}; }
  int size() const { return size_; }
  bool full() const { return size_ == kMaxCandidates; }

 private:
  CellPlane planes_[kMaxCandidates];
  int size_ = 0;
};

/// The best join of up to three candidates: the fewest wrong samples in the cell, few in the 26
/// around it, few planes; then fitted jointly, each wrong sample charged to the plane that is the
/// surface there. Not solved if nothing explains the cell.
CellModel solve_crease(const CellGrid& grid, int id, const Candidates& candidates);

}  // namespace soilvdb::inline v0
