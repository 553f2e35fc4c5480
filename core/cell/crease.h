// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Cells in which planes meet: the combination of nearby planes that explains their samples.
#pragma once

#include <span>

#include "core/cell/cell_model.h"

namespace soilvdb::inline v0 {

/// Planes that may meet in a cell, relative to it, the likeliest first, without similar ones.
class Candidates {
 public:
  /// Adds a plane unless it is far from the cell, similar to another, or there is no room.
  void add(const CellPlane& plane);
  std::span<const CellPlane> planes() const { return {planes_, static_cast<std::size_t>(size_)}; }
  int size() const { return size_; }
  bool full() const { return size_ == kMaxCandidates; }

 private:
  CellPlane planes_[kMaxCandidates];
  int size_ = 0;
};

/// The best combination of up to three candidates: with the fewest wrong samples in the cell, few
/// in the 26 around it, and few planes. Its planes are then fitted together; each wrong sample
/// counts for the plane that is the surface there. Not solved if no combination explains the cell.
CellModel solve_crease(const CellGrid& grid, int id, const Candidates& candidates);

}  // namespace soilvdb::inline v0
