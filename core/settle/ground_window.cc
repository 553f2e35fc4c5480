// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/ground_window.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "core/lattice/cell_counts.h"

namespace soilvdb::inline v0 {
namespace {

constexpr int kSlopeCells = 2;  // below its middle in which ground may have air

int chunk_floor(int cell) { return cell & ~(kChunkSide - 1); }

/// What one column has come to on the way down.
struct Walk {
  bool open = false;      // it is in the window, and its bank isn't found
  bool topped = false;    // its top is found
  double above = 0;       // samples of cells that aren't full, above the topmost full one
  double bank_above = 0;  // the same of bank soil, above the topmost cell full of that
  int piece_high = 0;     // topmost cell of the piece of soil it is in
  std::int64_t piece = 0, piece_bank = 0;  // samples of that, from there down
  bool base_read = false;                  // `base` is what the base surface has
  std::optional<double> base;
};

/// Mean height of the base surface over a column, nearly what a count will find: that of its middle
/// is a cell off beside cliffs. Index space.
std::optional<double> base_height(const Soil& soil, int x, int y) {
  double sum = 0;
  for (const double u : {-0.25, 0.25}) {
    for (const double v : {-0.25, 0.25}) {
      const Vec3 p = soil.world_from_index(Vec3(x + u, y + v, 0));
      const auto height = soil.base().height(p.x(), p.y());
      if (!height) return std::nullopt;
      sum += *height;
    }
  }
  return (sum / 4 - soil.origin().z()) / soil.voxel_size_m();
}

/// What the base surface has over a column of chunks.
struct Terrain {
  std::optional<int> highest;  // no soil is above this chunk; nothing where there is no ground
  bool whole = true;           // there is ground everywhere
};

/// Has a column of cells ground all over it? Where that ends within, no cell would ever be full.
bool all_ground(const Soil& soil, int x, int y) {
  constexpr double kInside = 0.499;
  const auto has = [&](double u, double v) {
    const Vec3 p = soil.world_from_index(Vec3(x + u, y + v, 0));
    return soil.base().height(p.x(), p.y()).has_value();
  };
  return has(0, 0) && has(-kInside, -kInside) && has(-kInside, kInside) && has(kInside, -kInside) &&
         has(kInside, kInside);
}

Terrain terrain_of(const Soil& soil, int cx, int cy) {
  Terrain terrain;
  std::optional<int>& z = terrain.highest;
  double low = std::numeric_limits<double>::infinity();
  const auto look = [&](int x, int y) {
    const Vec3 p = soil.world_from_index(Vec3(cx + x, cy + y, 0));
    const auto height = soil.base().height(p.x(), p.y());
    if (!height) return;
    low = std::min(low, *height);
    const int chunk = chunk_floor(
        static_cast<int>(std::floor((*height - soil.origin().z()) / soil.voxel_size_m() + 0.5)));
    z = std::max(z.value_or(chunk), chunk);
  };
  for (const Coord2& at : {Coord2(4, 4), Coord2(0, 0), Coord2(7, 0), Coord2(0, 7), Coord2(7, 7)})
    look(at.x(), at.y());
  const double h = soil.voxel_size_m();
  const Vec3 corner = soil.world_from_index(Vec3(cx - 0.5, cy - 0.5, 0));
  const Vec3 floor(corner.x(), corner.y(), low - h);
  terrain.whole = z && soil.base().known({floor, floor + Vec3(8 * h, 8 * h, h)});
  for (int c = 0; !terrain.whole && c < kChunkSide * kChunkSide; ++c)  // islands, cliffs at holes
    look(c / kChunkSide, c % kChunkSide);
  while (z && soil.classify({cx, cy, *z + kChunkSide}) != Content::kAir) *z += kChunkSide;
  const Eigen::AlignedBox3i above = soil.above_base();
  const Eigen::AlignedBox2i plan(above.min().head<2>(), above.max().head<2>());
  if (!above.isEmpty() && plan.contains(Coord2(cx, cy)))
    z = std::max(z.value_or(above.max().z()), above.max().z());
  return terrain;
}

}  // namespace

GroundWindow::GroundWindow(const Soil& soil, const Coord2& first, int nx, int ny)
    : first_(first), nx_(nx), ny_(ny), columns_(static_cast<std::size_t>(nx * ny)) {
  for (int cx = chunk_floor(first.x()); cx < first.x() + nx; cx += kChunkSide)
    for (int cy = chunk_floor(first.y()); cy < first.y() + ny; cy += kChunkSide)
      read_chunk_column(soil, cx, cy);
}

/// Goes down a column of chunks until all columns of cells have come to bank soil.
void GroundWindow::read_chunk_column(const Soil& soil, int cx, int cy) {
  const Terrain terrain = terrain_of(soil, cx, cy);
  if (!terrain.highest) return;
  Walk walks[kChunkSide * kChunkSide];
  int open = 0;
  const auto inside = [&](int x, int y) { return x >= 0 && y >= 0 && x < nx_ && y < ny_; };
  const auto column = [&](int c) -> Column& {
    return columns_[index(cx + c / kChunkSide - first_.x(), cy + c % kChunkSide - first_.y())];
  };
  for (int c = 0; c < kChunkSide * kChunkSide; ++c) {
    const int x = cx + c / kChunkSide, y = cy + c % kChunkSide;
    walks[c].open = inside(x - first_.x(), y - first_.y());
    if (walks[c].open && !terrain.whole) walks[c].open = all_ground(soil, x, y);
    open += walks[c].open;
  }
  // solid: height of what is full from there down; full: the topmost cell that surely is.
  const auto end = [&](int c, double solid, int full) {
    Walk& walk = walks[c];
    Column& out = column(c);
    out.bank_full = full;
    if (!walk.topped) {
      out.top = solid + walk.above / 64.0;
      out.full = full;
    }
    out.bank = std::min(out.top, solid + walk.bank_above / 64.0);
    out.known = true;
    walk.open = false;
    --open;
  };
  const auto gap = [&](int c, int z) {
    Walk& walk = walks[c];
    if (walk.piece > 0 && walk.piece_bank == 0) {
      Column& out = column(c);
      out.hangs = walk.piece;
      out.hangs_low = z + 1;
      out.hangs_high = walk.piece_high;
      has_hanging_ = true;
    }
    walk.piece = walk.piece_bank = 0;
  };
  const auto all_gap = [&](int z) {
    for (int c = 0; c < kChunkSide * kChunkSide; ++c)
      if (walks[c].open) gap(c, z + kChunkSide - 1);
  };
  SampleWords words, loose;
  CellCounts counts, loose_counts;
  loose_counts.fill(0);
  for (int z = chunk_floor(*terrain.highest); open > 0; z -= kChunkSide) {
    const Coord3 origin(cx, cy, z);
    const Chunk* chunk = soil.find(origin);
    if (chunk == nullptr) {
      const double low = z - 0.5, high = low + kChunkSide;
      for (int c = 0; c < kChunkSide * kChunkSide; ++c) {
        Walk& walk = walks[c];
        if (!walk.open) continue;
        if (!walk.base_read) {
          walk.base = base_height(soil, cx + c / kChunkSide, cy + c % kChunkSide);
          walk.base_read = true;
        }
        if (!walk.base) {  // a wall
          walk.open = false;
          --open;
        } else if (*walk.base >= low + 1) {
          if (*walk.base < high - 1) gap(c, z + kChunkSide - 1);
          const double solid = std::min(*walk.base, high);
          // Where ground slopes, cells below its middle have air, too.
          end(c, solid, static_cast<int>(std::floor(solid - 0.5)) - kSlopeCells);
        } else {
          gap(c, z + kChunkSide - 1);
          if (*walk.base <= low) continue;
          // The full cell is in the chunk below, if it's still there.
          walk.above += 64 * (*walk.base - low);
          walk.bank_above += 64 * (*walk.base - low);
        }
      }
      continue;
    }
    if (chunk->soil_count == 0) {
      all_gap(z);
      continue;
    }
    soil.read_samples(origin, words);
    const bool some_loose = chunk->loose_count > 0;
    has_loose_ |= some_loose;
    count_cells(words, counts);
    if (some_loose) {
      soil.read_loose(origin, loose);
      count_cells(loose, loose_counts);
    } else {
      loose_counts.fill(0);
    }
    for (int c = 0; c < kChunkSide * kChunkSide; ++c) {
      Walk& walk = walks[c];
      for (int k = kChunkSide - 1; k >= 0 && walk.open; --k) {
        const auto n = static_cast<std::size_t>(c * kChunkSide + k);
        const int all = counts[n], bank = all - loose_counts[n];
        const double solid = z + k + 0.5;
        if (bank == 64) {
          end(c, solid, z + k);
        } else if (!walk.topped && all == 64) {
          column(c).top = solid + walk.above / 64.0;
          column(c).full = z + k;
          walk.topped = true;
        }
        if (all == 0) {
          gap(c, z + k);
        } else {
          if (walk.piece == 0) walk.piece_high = z + k;
          walk.piece += all;
          walk.piece_bank += bank;
        }
        walk.above += all;
        walk.bank_above += bank;
      }
    }
  }
}

}  // namespace soilvdb::inline v0
