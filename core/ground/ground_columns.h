// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground as columns of cells: tiles of 8 x 8, read once and kept until the ground changes
// there.
#pragma once

#include <array>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <unordered_map>
#include <vector>

#include "core/ground/base_columns.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/change_follower.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// The topmost soil of a column of cells, in index space: the top of cell k is at k + 0.5. Heights
/// are counted: soil above the topmost cell full of bank counts with its volume, so added soil
/// fills pores below before heights rise.
struct GroundColumn {
  double top = 0;      ///< of all soil
  double surface = 0;  ///< top of the topmost cell with soil, pores below it or not
  double bank = 0;     ///< of the soil without the loose soil on it
  int full = 0;        ///< all cells are full up to this one: nothing can be added below
  int bank_full = 0;   ///< the topmost cell full of bank soil
  bool known = false;  ///< the terrain has ground everywhere in it
  /// Loose soil without support: the lowest piece, its cells and samples.
  int hangs_low = 0, hangs_high = 0;
  std::int64_t hangs = 0;
};

/// The columns over one column of chunks: column (x, y) from the lowest cell is entry x * 8 + y.
struct ColumnTile {
  std::array<GroundColumn, BaseColumn::kCells> columns;
  std::uint64_t read = 0;  ///< bits of the columns that were
  bool has_loose = false, has_hanging = false;
};

/// Reads a tile. Where only some of a column's chunks are resident its heights may err by a sample
/// or two. @param cx, cy the chunks' lowest cell
ColumnTile read_tile(BaseColumns& base, int cx, int cy);
/// Above all cells.
inline constexpr int kNoCeiling = std::numeric_limits<int>::max() / 2;
/// May chunks be resident over or in the surface of a tile?
bool is_touched(BaseColumns& base, int cx, int cy);
/// Reads a tile to the sample, which takes longer where chunks of the surface aren't resident.
/// @param ceiling the highest cell that is looked at; all above it counts as air
/// @param initial what the tile was before anything changed
/// @param columns bits of those to read, by their numbers; others are where that costs little
ColumnTile read_tile_exactly(BaseColumns& base, int cx, int cy, int ceiling, bool initial,
                             std::uint64_t columns = ~std::uint64_t{0});

/// Columns are looked at that GroundColumns was not given.
struct OutOfReach : std::exception {
  const char* what() const noexcept override { return "soil moves farther than its machines do"; }
};

/// The tiles of a ground that were looked at. Several threads may each use
/// their own, if no other changes the ground within the columns that each is given.
class GroundColumns {
 public:
  /// @param ground outlives it
  explicit GroundColumns(Ground& ground);
  /// For a clone of the other's ground.
  GroundColumns(Ground& clone, const GroundColumns& other)
      : base_(clone, other.base_), changes_(clone, other.changes_) {}

  GroundColumns(const GroundColumns&) = delete;
  GroundColumns& operator=(const GroundColumns&) = delete;

  BaseColumns& base() { return base_; }
  /// Gives it the columns of a box of cells, whole tiles; empty: all.
  void confine(const Eigen::AlignedBox2i& cells) {
    reach_ = cells;
    last_ = nullptr;
  }
  bool reaches(const Coord2& cell) const { return reach_.isEmpty() || reach_.contains(cell); }
  /// As it was at the last call of take_changes(), and valid until the next. @param cx, cy the
  /// lowest cell. @throw OutOfReach
  const ColumnTile& tile(int cx, int cy);
  const GroundColumn& column(const Coord2& cell) {
    const Coord2 corner = floor_to(cell, kChunkSide), in = cell - corner;
    return tile(corner.x(), corner.y())
        .columns[static_cast<std::size_t>(in.x() * kChunkSide + in.y())];
  }
  /// Calls f(cell, column) for each column of a box of cells, tile by tile.
  template <typename F>
  void each(const Eigen::AlignedBox2i& cells, const F& f) {
    const Coord2 first = floor_to(cells.min(), kChunkSide);
    for (int cx = first.x(); cx <= cells.max().x(); cx += kChunkSide) {
      for (int cy = first.y(); cy <= cells.max().y(); cy += kChunkSide) {
        const ColumnTile& read = tile(cx, cy);
        const Coord2 low = cells.min().cwiseMax(Coord2(cx, cy));
        const Coord2 end = cells.max().cwiseMin(Coord2(cx, cy) + Coord2::Constant(kChunkSide - 1));
        for (int x = low.x(); x <= end.x(); ++x)
          for (int y = low.y(); y <= end.y(); ++y)
            f(Coord2(x, y), read.columns[static_cast<std::size_t>((x - cx) * kChunkSide + y - cy)]);
      }
    }
  }
  /// Lowest cells of the tiles in which the ground changed since the last call. They are read anew.
  /// So are all, if more than kMaxColumnTiles were kept.
  std::vector<Coord2> take_changes();

 private:
  BaseColumns base_;
  ChangeFollower changes_;
  Eigen::AlignedBox2i reach_;
  /// Keeps its memory while the ground changes there.
  struct Kept {
    ColumnTile tile;
    bool is_new = false;  // read since the last change
  };
  std::unordered_map<std::uint64_t, Kept> tiles_;
  const ColumnTile* last_ = nullptr;  // the one that was asked for last, most often the next, too
  std::uint64_t last_key_ = 0;
};

}  // namespace soilvdb::inline v0
