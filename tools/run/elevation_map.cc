// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/elevation_map.h"

#include <algorithm>
#include <limits>

#include "core/lattice/chunk_math.h"
#include "soilvdb/samples.h"

namespace soilvdb::tools {
namespace {

constexpr int kTile = 32;               // step of the grid's growth, cells
constexpr int kReach = kChunkSide + 2;  // distance of surface cells that a chunk affects, voxels
constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

}  // namespace

Vec2 ElevationMap::corner_m() const {
  // Cells reach half a voxel beyond their centres.
  return (grid_.min().cast<double>() - Vec2::Constant(0.5)) * ground_.voxel_size_m();
}

Vec2 ElevationMap::middle_m(int x, int y) const {
  return corner_m() + (Vec2(x, y) + Vec2::Constant(0.5)) * cell_m();
}

/// Makes the map cover `grid`, and keeps the known heights.
void ElevationMap::grow(const Box& grid, int side) {
  const Box before = grid_;
  const std::vector<float> heights_m = std::move(heights_m_);
  const bool same_cells = side == side_ && !before.isEmpty();
  grid_ = grid;
  side_ = side;
  const int nx = cells(0), ny = cells(1);
  heights_m_.assign(static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny), kUnknown);
  stale_.assign(heights_m_.size(), 1);
  if (!same_cells) return;
  const Eigen::Vector2i from = (before.min() - grid.min()) / side, size = before.sizes() / side;
  for (int y = 0; y < size.y(); ++y) {
    const std::ptrdiff_t to = static_cast<std::ptrdiff_t>(from.y() + y) * nx + from.x();
    const auto row = heights_m.begin() + static_cast<std::ptrdiff_t>(y) * size.x();
    std::copy(row, row + size.x(), heights_m_.begin() + to);
    std::fill_n(stale_.begin() + to, size.x(), 0);
  }
}

void ElevationMap::update(std::span<const Coord3> changed) {
  if (changed.empty()) return;
  surface_.update(changed);
  for (const Coord3& chunk : changed) {
    touched_.extend(Eigen::Vector2i(chunk.head<2>()));
    touched_.extend(Eigen::Vector2i(chunk.head<2>().array() + kChunkSide));
  }
  int side = side_;
  Box grid;
  for (;; side *= 2) {
    const int tile = kTile * side;
    grid = Box();
    for (int axis = 0; axis < 2; ++axis) {
      grid.min()[axis] = floor_to(touched_.min()[axis], tile);
      grid.max()[axis] = floor_to(touched_.max()[axis] + tile - 1, tile);
    }
    const Eigen::Vector2i cells = grid.sizes() / side;
    if (std::int64_t{cells.x()} * cells.y() <= kMostCells) break;
  }
  if (side != side_ || grid_.isEmpty() || grid.min() != grid_.min() || grid.max() != grid_.max())
    grow(grid, side);
  const int nx = cells(0), ny = cells(1);
  for (const Coord3& chunk : changed) {
    const auto cell = [&](int voxel, int axis, int most) {
      return std::clamp((voxel - grid_.min()[axis]) / side_, 0, most);
    };
    const int x1 = cell(chunk.x() + kChunkSide + kReach, 0, nx - 1);
    for (int y = cell(chunk.y() - kReach, 1, ny - 1);
         y <= cell(chunk.y() + kChunkSide + kReach, 1, ny - 1); ++y)
      for (int x = cell(chunk.x() - kReach, 0, nx - 1); x <= x1; ++x)
        stale_[static_cast<std::size_t>(y) * size_x() + static_cast<std::size_t>(x)] = 1;
  }
  std::vector<Vec2> places_m;
  for (int y = 0; y < ny; ++y)
    for (int x = 0; x < nx; ++x)
      if (stale_[static_cast<std::size_t>(y) * size_x() + static_cast<std::size_t>(x)])
        places_m.push_back(middle_m(x, y) + ground_.origin().head<2>());
  std::vector<double> found_m(places_m.size());
  surface_.at(places_m, found_m);
  auto next = found_m.begin();
  for (std::size_t i = 0; i < heights_m_.size(); ++i) {
    if (!stale_[i]) continue;
    heights_m_[i] = static_cast<float>(*next++ - ground_.origin().z());
    stale_[i] = 0;
  }
}

}  // namespace soilvdb::tools
