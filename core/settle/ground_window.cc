// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/ground_window.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/lattice/cell_counts.h"

namespace soilvdb::inline v0 {
namespace {

int chunk_floor(int cell) { return cell & ~(kChunkSide - 1); }

/// What one column has come to on the way down.
struct Walk {
  bool open = false;    // it is in the window, and its bank isn't found
  bool topped = false;  // its top is found
  int above = 0;        // samples of cells that aren't full, above the topmost full one
  int bank_above = 0;   // the same of bank soil, above the topmost cell full of that
  int piece_high = 0;   // topmost cell of the piece of soil it is in
  std::int64_t piece = 0, piece_bank = 0;  // samples of that, from there down
  bool base_read = false;                  // `base` is what the base surface has
  std::optional<double> base;
};

/// Nothing of a column of chunks is above this one; nothing where there is no ground.
std::optional<int> highest_chunk(const Soil& soil, int cx, int cy) {
  std::optional<int> z;
  for (const Coord2& at : {Coord2(4, 4), Coord2(0, 0), Coord2(7, 0), Coord2(0, 7), Coord2(7, 7)}) {
    const Vec3 p = soil.world_from_index(Vec3(cx + at.x(), cy + at.y(), 0));
    const auto height = soil.base().height(p.x(), p.y());
    if (!height) continue;
    z = chunk_floor(
        static_cast<int>(std::floor((*height - soil.origin().z()) / soil.voxel_size_m() + 0.5)));
    while (soil.classify({cx, cy, *z + kChunkSide}) != Content::kAir) *z += kChunkSide;
    break;
  }
  const Eigen::AlignedBox3i above = soil.above_base();
  const Eigen::AlignedBox2i plan(above.min().head<2>(), above.max().head<2>());
  if (!above.isEmpty() && plan.contains(Coord2(cx, cy)))
    z = std::max(z.value_or(above.max().z()), above.max().z());
  return z;
}

}  // namespace

GroundWindow::GroundWindow(const Soil& soil, const Coord2& first, int nx, int ny)
    : first_(first), nx_(nx), ny_(ny), columns_(static_cast<std::size_t>(nx * ny)) {
  for (int cx = chunk_floor(first.x()); cx < first.x() + nx; cx += kChunkSide)
    for (int cy = chunk_floor(first.y()); cy < first.y() + ny; cy += kChunkSide)
      if (const auto z = highest_chunk(soil, cx, cy)) read_chunk_column(soil, cx, cy, *z);
}

/// Goes down a column of chunks until all columns of cells have come to bank soil.
void GroundWindow::read_chunk_column(const Soil& soil, int cx, int cy, int top_z) {
  Walk walks[kChunkSide * kChunkSide];
  int open = 0;
  const auto inside = [&](int x, int y) { return x >= 0 && y >= 0 && x < nx_ && y < ny_; };
  const auto column = [&](int c) -> Column& {
    return columns_[index(cx + c / kChunkSide - first_.x(), cy + c % kChunkSide - first_.y())];
  };
  for (int c = 0; c < kChunkSide * kChunkSide; ++c) {
    walks[c].open = inside(cx + c / kChunkSide - first_.x(), cy + c % kChunkSide - first_.y());
    open += walks[c].open;
  }
  const auto end = [&](int c, double solid) {  // solid: height of what is full from there down
    Walk& walk = walks[c];
    Column& out = column(c);
    out.bank_full = static_cast<int>(std::ceil(solid - 0.5)) - 1;
    if (!walk.topped) {
      out.top = solid + walk.above / 64.0;
      out.full = out.bank_full;
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
  for (int z = chunk_floor(top_z); open > 0; z -= kChunkSide) {
    const Coord3 origin(cx, cy, z);
    const Chunk* chunk = soil.find(origin);
    if (chunk == nullptr) {
      const double low = z - 0.5, high = low + kChunkSide;
      for (int c = 0; c < kChunkSide * kChunkSide; ++c) {
        Walk& walk = walks[c];
        if (!walk.open) continue;
        if (!walk.base_read) {
          const Vec3 at = soil.world_from_index(Vec3(cx + c / kChunkSide, cy + c % kChunkSide, 0));
          walk.base = soil.base().height(at.x(), at.y());
          if (walk.base) walk.base = (*walk.base - soil.origin().z()) / soil.voxel_size_m();
          walk.base_read = true;
        }
        if (!walk.base) {  // a wall
          walk.open = false;
          --open;
        } else if (*walk.base > low) {
          if (*walk.base < high - 1) gap(c, z + kChunkSide - 1);
          end(c, std::min(*walk.base, high));
        } else {
          gap(c, z + kChunkSide - 1);
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
          end(c, solid);
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
