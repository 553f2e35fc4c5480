// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights of the touched ground, on a grid of limited size.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <span>
#include <vector>

#include "soilvdb/ground.h"
#include "soilvdb/surface_height.h"

namespace soilvdb::tools {

/// A height per cell of a grid over all changed chunks. Cells are a voxel wide if this gives at
/// most `kMostCells` cells, else 2, 4, 8 voxels and so on. An update recomputes only changed
/// places. The heights do not depend on the number of threads. Not thread-safe.
class ElevationMap {
 public:
  static constexpr std::int64_t kMostCells = 1 << 16;

  /// @param ground must outlive the map
  explicit ElevationMap(const Ground& ground) : ground_(ground), surface_(ground) {}

  /// @param changed chunks since the last call; at first all
  void update(std::span<const Coord3> changed);

  bool empty() const { return heights_m_.empty(); }
  double cell_m() const { return ground_.voxel_size_m() * side_; }
  std::size_t size_x() const { return static_cast<std::size_t>(cells(0)); }
  std::size_t size_y() const { return static_cast<std::size_t>(cells(1)); }
  /// The lowest corner, m, relative to Ground::origin().
  Vec2 corner_m() const;
  /// Topmost soil, m, relative to Ground::origin(); NaN without soil. x varies fastest.
  std::span<const float> heights_m() const { return heights_m_; }

 private:
  using Box = Eigen::AlignedBox2i;  // in voxels; max() is one past the end
  int cells(int axis) const { return grid_.isEmpty() ? 0 : grid_.sizes()[axis] / side_; }
  void grow(const Box& grid, int side);
  Vec2 middle_m(int x, int y) const;

  const Ground& ground_;
  SurfaceHeight surface_;
  Box touched_, grid_;
  int side_ = 1;  // of a cell, voxels
  std::vector<float> heights_m_;
  std::vector<char> stale_;  // cells to recompute
};

}  // namespace soilvdb::tools
