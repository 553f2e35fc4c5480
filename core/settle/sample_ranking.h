// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Which samples of a few cells over each other come first above or below a surface.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {

/// The shape of a surface over a column of cells, from the column's corner, cells.
struct ColumnSurface {
  bool cone;
  float a, b;   ///< a cone's apex, or a plane's slopes
  float slope;  ///< of the cone
  float up;     ///< 1: what is lowest above it comes first; -1: what is highest
};

/// Puts samples into the order of their heights above a surface, which are in fixed point, so that
/// it is the same however they were computed; ties in the order of cells and samples. Keeps its
/// memory.
class SampleRanking {
 public:
  void clear();
  /// Adds the next cell upwards. @param low its lower side; `may`: samples that count
  void add(const CellPoints& points, float low, const ColumnSurface& surface, std::uint64_t may);
  /// So many samples that come first, all if there are fewer: a word for each cell, valid until the
  /// next call.
  std::span<const std::uint64_t> first(std::int64_t count);

 private:
  std::vector<std::int32_t> heights_;  // 64 for each cell, kNever where none counts
  std::vector<std::uint64_t> words_;
  std::int64_t samples_ = 0;
  std::int32_t lowest_, highest_;
};

}  // namespace soilvdb::inline v0
