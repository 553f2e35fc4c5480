// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tests/support/ground_window.h"

#include <algorithm>

#include "core/lattice/chunk_math.h"

namespace soilvdb::test {

GroundWindow::GroundWindow(const Ground& ground, const Coord2& first, int nx, int ny)
    : first_(first), nx_(nx), ny_(ny), columns_(static_cast<std::size_t>(nx * ny)) {
  BaseColumns base(ground);
  const Coord2 end = first_ + Coord2(nx_, ny_);
  for (int cx = floor_to(first_.x(), kChunkSide); cx < end.x(); cx += kChunkSide) {
    for (int cy = floor_to(first_.y(), kChunkSide); cy < end.y(); cy += kChunkSide) {
      const ColumnTile tile = read_tile(base, cx, cy);
      has_hanging_ |= tile.has_hanging;
      const int y = std::max(cy, first_.y()), count = std::min(cy + kChunkSide, end.y()) - y;
      for (int x = std::max(cx, first_.x()); x < std::min(cx + kChunkSide, end.x()); ++x)
        std::copy_n(&tile.columns[static_cast<std::size_t>((x - cx) * kChunkSide + y - cy)], count,
                    &columns_[index(x - first_.x(), y - first_.y())]);
    }
  }
}

}  // namespace soilvdb::test
