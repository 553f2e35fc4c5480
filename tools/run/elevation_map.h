// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights of the ground that was touched, on a grid that stays small.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <span>
#include <vector>

#include "soilvdb/ground.h"
#include "soilvdb/surface_height.h"

namespace soilvdb::tools {

/// A height at the middle of each cell of a grid over all chunks that changed. Cells are a voxel
/// wide while that makes no more than `kMostCells`, else 2, 4, 8 and so on. An update looks only
/// where something changed. The same for any number of threads. For one thread.
class ElevationMap {
 public:
  static constexpr std::int64_t kMostCells = 1 << 16;

  /// @param ground outlives it
  explicit ElevationMap(const Ground& ground) : ground_(ground), surface_(ground) {}

  /// @param changed chunks since the last time; the first time all that there are
  void update(std::span<const Coord3> changed);

  bool empty() const { return heights_m_.empty(); }
  double cell_m() const { return ground_.voxel_size_m() * side_; }
  std::size_t size_x() const { return static_cast<std::size_t>(cells(0)); }
  std::size_t size_y() const { return static_cast<std::size_t>(cells(1)); }
  /// The lowest corner, m, seen from Ground::origin().
  Vec2 corner_m() const;
  /// Of the topmost soil, m, seen from Ground::origin(); NaN where there is none. Along x first.
  std::span<const float> heights_m() const { return heights_m_; }

 private:
  using Box = Eigen::AlignedBox2i;  // of voxels; max() is the first beyond it
  int cells(int axis) const { return grid_.isEmpty() ? 0 : grid_.sizes()[axis] / side_; }
  void grow(const Box& grid, int side);
  Vec2 middle_m(int x, int y) const;

  const Ground& ground_;
  SurfaceHeight surface_;
  Box touched_, grid_;
  int side_ = 1;  // of a cell, voxels
  std::vector<float> heights_m_;
  std::vector<char> stale_;  // cells to look at
};

}  // namespace soilvdb::tools
