// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/ground_window.h"

#include <algorithm>

#include "core/lattice/chunk_math.h"

namespace soilvdb::inline v0 {

template <typename TileAt>
void GroundWindow::read(const TileAt& tile_at) {
  const Coord2 end = first_ + Coord2(nx_, ny_);
  for (int cx = floor_to(first_.x(), kChunkSide); cx < end.x(); cx += kChunkSide) {
    for (int cy = floor_to(first_.y(), kChunkSide); cy < end.y(); cy += kChunkSide) {
      const ColumnTile& tile = tile_at(cx, cy);
      has_loose_ |= tile.has_loose;
      has_hanging_ |= tile.has_hanging;
      const int y = std::max(cy, first_.y()), count = std::min(cy + kChunkSide, end.y()) - y;
      for (int x = std::max(cx, first_.x()); x < std::min(cx + kChunkSide, end.x()); ++x)
        std::copy_n(&tile.columns[static_cast<std::size_t>((x - cx) * kChunkSide + y - cy)], count,
                    &columns_[index(x - first_.x(), y - first_.y())]);
    }
  }
}

GroundWindow::GroundWindow(GroundColumns& ground, const Coord2& first, int nx, int ny)
    : first_(first), nx_(nx), ny_(ny), columns_(static_cast<std::size_t>(nx * ny)) {
  read([&](int cx, int cy) -> const ColumnTile& { return ground.tile(cx, cy); });
}

GroundWindow::GroundWindow(const Ground& ground, const Coord2& first, int nx, int ny)
    : first_(first), nx_(nx), ny_(ny), columns_(static_cast<std::size_t>(nx * ny)) {
  BaseColumns base(ground);
  read([&](int cx, int cy) { return read_tile(base, cx, cy); });
}

}  // namespace soilvdb::inline v0
