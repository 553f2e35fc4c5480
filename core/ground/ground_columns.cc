// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/ground/ground_columns.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::inline v0 {
namespace {

/// Goes down columns of chunks until all their columns of cells have come to bank soil.
class TileReader {
 public:
  /// What is read: chunks, and heights of the terrain where none is resident; or samples alone; or
  /// those of the terrain.
  enum class By { kHeights, kSamples, kTerrain };

  /// @param columns bits of those to read
  /// @param tile of nothing yet
  TileReader(BaseColumns& base, int cx, int cy, int ceiling, By by, ColumnTile& tile,
             std::uint64_t columns = ~std::uint64_t{0})
      : cx_(cx),
        cy_(cy),
        by_(by),
        bases_(base),
        base_(base.at(cx, cy)),
        ground_(base.ground()),
        above_(ground_.above_base()),
        ceiling_(ceiling),
        columns_(columns),
        terrain_(base.chunks()),
        tile_(tile) {}

  void read() {
    if (!base_.some && !raised()) {
      tile_.read = ~std::uint64_t{0};
      return;
    }
    if (by_ == By::kHeights) return read(columns_);
    last_ = last_chunk();
    // None above the highest is mixed, whatever the ceiling.
    terrain_.begin({cx_, cy_}, (base_.highest - last_) / kChunkSide + 1);
    read(columns_);
    // The terrain's samples take longest to make.
    if (terrain_.was_read()) read(~columns_);
  }

  /// The lowest chunk that is looked at, some way below the terrain's lowest ground here.
  int last_chunk() const {
    int lowest = std::min(base_.highest, top_chunk());
    for (const double height : base_.heights)
      if (base_.some && !std::isnan(height)) lowest = std::min(lowest, cell_of(height));
    return floor_to(lowest, kChunkSide) - 2 * kMaxCountedChunks * kChunkSide;
  }
  bool is_touched() const {
    if (!base_.some && !raised()) return false;
    const int last = last_chunk();
    for (int z = top_chunk(); z >= last; z -= kChunkSide)
      if (ground_.find({cx_, cy_, z}) != nullptr) return true;
    return false;
  }

 private:
  /// What one column has come to on the way down.
  struct Walk {
    bool some = false;    // it came to soil
    bool filled = false;  // all cells are full from `full` down to here
    int full = 0;
    int piece_high = 0;             // topmost cell of the piece of soil it is in
    int piece = 0, piece_bank = 0;  // samples of that, from there down
    double above = 0;               // samples of cells that aren't full, above the topmost full one
    double bank_above = 0;          // the same of bank soil, above the topmost cell full of that
  };

  static constexpr int kCells = BaseColumn::kCells;

  void read(std::uint64_t columns) {
    tile_.read |= columns;
    open_ = columns & base_.all_ground;
    const std::uint64_t all = open_;
    for (int z = top_chunk(); open_ != 0; z -= kChunkSide) {
      const Chunk* chunk = by_ == By::kTerrain ? nullptr : ground_.find({cx_, cy_, z});
      if (chunk == nullptr && by_ != By::kHeights && is_mixed(z)) {
        through_samples(terrain_.read(ground_, {cx_, cy_, z}), nullptr, z);
      } else if (chunk == nullptr && !(base_.whole && z > base_.highest)) {
        through_base(z);
      } else if (chunk == nullptr || chunk->soil_count == 0) {
        through_air(z);
      } else if (chunk->swap_record != 0) {
        const Chunk copy = ground_.copy(*chunk);
        through_samples(copy.samples, loose_of(copy), z);
      } else {
        through_samples(chunk->samples, loose_of(*chunk), z);
      }
    }
    if (by_ != By::kHeights) subtract_pores(all);
  }

  /// Calls f(c) for each bit of a set of columns.
  template <typename F>
  static void each_of(std::uint64_t columns, const F& f) {
    for (; columns != 0; columns &= columns - 1) f(std::countr_zero(columns));
  }
  bool raised() const {
    const Eigen::AlignedBox2i plan(above_.min().head<2>(), above_.max().head<2>());
    return by_ != By::kTerrain && !above_.isEmpty() && plan.contains(Coord2(cx_, cy_));
  }
  int top_chunk() const {
    int z = base_.some ? base_.highest : above_.max().z();
    if (raised()) z = std::max(z, above_.max().z());
    return floor_to(std::min(z, ceiling_), kChunkSide);
  }
  /// May the terrain's surface be in a chunk, and be read as samples?
  bool is_mixed(int z) const { return z >= last_ && bases_.is_mixed({cx_, cy_, z}); }
  static const Samples* loose_of(const Chunk& chunk) {
    return chunk.loose_count > 0 ? &chunk.loose : nullptr;
  }
  /// Lowers columns by what is missing below their topmost full cell, as where a tool cut some
  /// samples from the side. Not over a cell without soil, or where more than a cell is missing:
  /// what is above that is a roof.
  void subtract_pores(std::uint64_t columns) {
    int last = top_chunk();
    std::uint64_t known = 0;
    std::array<int, kCells> lasts = {};
    each_of(columns, [&](int c) {
      if (!column(c).known) return;
      known |= bit(c);
      const int full = floor_to(column(c).bank_full, kChunkSide);
      int& of_column = lasts[static_cast<std::size_t>(c)];
      of_column = std::min(last_, full - kMaxCountedChunks * kChunkSide);
      last = std::min(last, of_column);
    });
    if (known == 0) return;
    std::array<int, kCells> missing = {};
    std::uint64_t roofs = 0;
    for (int z = top_chunk(); z >= last; z -= kChunkSide) {
      const Chunk* chunk = by_ == By::kTerrain ? nullptr : ground_.find({cx_, cy_, z});
      if (chunk == nullptr && !is_mixed(z)) continue;
      const auto count = [&](const auto& samples) {
        each_of(known & ~roofs, [&](int c) {
          if (z < lasts[static_cast<std::size_t>(c)] ||
              samples.full_of_row(c * kChunkSide) == (1u << kChunkSide) - 1)
            return;
          for (int k = std::min(kChunkSide - 1, column(c).bank_full - 1 - z); k >= 0; --k) {
            const int some = std::popcount(samples.word(c * kChunkSide + k));
            if (some == 0) roofs |= bit(c);
            missing[static_cast<std::size_t>(c)] += 64 - some;
          }
        });
      };
      if (chunk == nullptr) {
        count(terrain_.read(ground_, {cx_, cy_, z}));
      } else if (chunk->swap_record != 0) {
        count(ground_.copy(*chunk).samples);
      } else {
        count(chunk->samples);
      }
    }
    each_of(known & ~roofs, [&](int c) {
      const double pores = missing[static_cast<std::size_t>(c)] / 64.0;
      if (pores > kMostPoreCells) return;
      column(c).top -= pores;
      column(c).bank -= pores;
    });
  }
  static constexpr std::uint64_t bit(int c) { return std::uint64_t{1} << c; }
  /// The cell of the chunk at z that is looked at first.
  int topmost(int z) const { return std::min(kChunkSide - 1, ceiling_ - z); }
  GroundColumn& column(int c) { return tile_.columns[static_cast<std::size_t>(c)]; }
  /// @param solid height of what is full from there down
  /// @param full the topmost cell that surely is
  void end(int c, double solid, int full) {
    Walk& walk = walks_[c];
    GroundColumn& out = column(c);
    found(c, solid);
    out.bank_full = full;
    out.full = walk.filled ? walk.full : full;
    out.top = solid + walk.above / 64.0;
    out.bank = std::min(out.top, solid + walk.bank_above / 64.0);
    out.known = true;
    open_ &= ~bit(c);
  }
  void found(int c, double surface) {
    if (!walks_[c].some) column(c).surface = surface;
    walks_[c].some = true;
  }
  /// @param z the cell without soil
  void gap(int c, int z) {
    Walk& walk = walks_[c];
    if (walk.piece > 0 && walk.piece_bank == 0) {
      GroundColumn& out = column(c);
      out.hangs = walk.piece;
      out.hangs_low = z + 1;
      out.hangs_high = walk.piece_high;
      tile_.has_hanging = true;
    }
    walk.piece = walk.piece_bank = 0;
    walk.filled = false;
  }

  void through_air(int z) {
    if (any_piece_) each_of(open_, [&](int c) { gap(c, z + kChunkSide - 1); });
  }

  void through_base(int z) {
    const double low = z - 0.5, high = low + topmost(z) + 1;
    each_of(open_, [&](int c) {
      Walk& walk = walks_[c];
      const double ground = base_.heights[static_cast<std::size_t>(c)];
      if (std::isnan(ground) && z > base_.highest) {
        gap(c, z + kChunkSide - 1);
      } else if (std::isnan(ground)) {  // a wall
        open_ &= ~bit(c);
      } else if (ground >= low + 1) {
        if (ground < high - 1) gap(c, z + kChunkSide - 1);
        const double solid = std::min(ground, high);
        // Where ground slopes, cells below its middle have air, too.
        end(c, solid, static_cast<int>(std::floor(solid - 0.5)) - kSlopeCells);
      } else {
        gap(c, z + kChunkSide - 1);
        if (ground <= low) return;
        found(c, ground);
        // The full cell is in the chunk below, if it's still there.
        walk.above += 64 * (ground - low);
        walk.bank_above += 64 * (ground - low);
      }
    });
  }

  /// @param loose null: none of it is
  template <typename Soil>
  SOILVDB_FOR_CPUS void through_samples(const Soil& soil, const Samples* loose, int z) {
    tile_.has_loose |= loose != nullptr;
    any_piece_ = true;
    const auto highest = [](std::uint32_t cells) {
      return static_cast<int>(std::bit_width(cells)) - 1;
    };
    for (std::uint64_t left = open_; left != 0; left &= left - 1) {
      const int c = std::countr_zero(left), row = c * kChunkSide;
      Walk& walk = walks_[c];
      const std::uint32_t some = soil.any_of_row(row), full = soil.full_of_row(row);
      const std::uint32_t moved = loose != nullptr ? loose->any_of_row(row) : 0;
      const std::uint32_t all_moved = loose != nullptr ? loose->full_of_row(row) : 0;
      for (int k = topmost(z); k >= 0;) {
        const std::uint32_t down = (2u << k) - 1;  // cells from k on
        if ((some >> k & 1) == 0) {                // down to the next that has some
          gap(c, z + k);
          k = highest(some & down);
          continue;
        }
        found(c, z + k + 0.5);
        // Those with soil above air, or above what is full of bank.
        const int bank_full = highest(full & ~moved & down);
        const int under = std::max(highest(~some & down), bank_full);
        const std::uint32_t cells = down & ~((1u << (under + 1)) - 1);
        if (cells != 0) {
          const std::uint32_t pores = cells & ~full;
          int all = 64 * std::popcount(cells & full);
          for (std::uint32_t i = pores; i != 0; i &= i - 1)
            all += std::popcount(soil.word(row + std::countr_zero(i)));
          int bank = all - 64 * std::popcount(cells & all_moved);
          for (std::uint32_t i = cells & moved & ~all_moved; i != 0; i &= i - 1)
            bank -= std::popcount(loose->word(row + std::countr_zero(i)));
          if (pores != 0 || !walk.filled) {
            const int filled = pores != 0 ? std::countr_zero(pores) - 1 : k;
            walk.filled = filled > under;
            walk.full = z + filled;
          }
          if (walk.piece == 0) walk.piece_high = z + k;
          walk.piece += all;
          walk.piece_bank += bank;
          walk.above += all;
          walk.bank_above += bank;
        }
        if (under == bank_full && under >= 0) {
          end(c, z + under + 0.5, z + under);
          break;
        }
        k = under;
      }
    }
  }

  const int cx_, cy_;
  const By by_;
  BaseColumns& bases_;
  const BaseColumn& base_;
  const Ground& ground_;
  const Eigen::AlignedBox3i above_;
  const int ceiling_;
  const std::uint64_t columns_;
  TerrainChunks& terrain_;
  int last_ = 0;  // as last_chunk(), if samples are read
  ColumnTile& tile_;
  Walk walks_[kCells];
  std::uint64_t open_ = 0;  // columns whose bank isn't found
  bool any_piece_ = false;
};

}  // namespace

ColumnTile read_tile(BaseColumns& base, int cx, int cy) {
  ColumnTile tile;
  TileReader(base, cx, cy, kNoCeiling, TileReader::By::kHeights, tile).read();
  return tile;
}

bool is_touched(BaseColumns& base, int cx, int cy) {
  ColumnTile tile;
  return TileReader(base, cx, cy, kNoCeiling, TileReader::By::kSamples, tile).is_touched();
}

ColumnTile read_tile_exactly(BaseColumns& base, int cx, int cy, int ceiling, bool initial,
                             std::uint64_t columns) {
  using By = TileReader::By;
  ColumnTile tile;
  TileReader(base, cx, cy, ceiling, initial ? By::kTerrain : By::kSamples, tile, columns).read();
  return tile;
}

GroundColumns::GroundColumns(Ground& ground) : base_(ground), changes_(ground) {
  changes_.take();  // what was there before
}

const ColumnTile& GroundColumns::tile(int cx, int cy) {
  const std::uint64_t key = plan_key({cx, cy});
  if (last_ != nullptr && key == last_key_) return *last_;
  if (!reaches({cx, cy})) throw OutOfReach();
  Kept& kept = tiles_[key];
  if (!kept.is_new) {
    kept.tile = {};
    TileReader(base_, cx, cy, kNoCeiling, TileReader::By::kHeights, kept.tile).read();
    kept.is_new = true;
  }
  last_key_ = key;
  last_ = &kept.tile;
  return *last_;
}

std::vector<Coord2> GroundColumns::take_changes() {
  last_ = nullptr;
  if (tiles_.size() > kMaxColumnTiles) tiles_.clear();
  std::vector<Coord2> changed;
  for (const Coord3& origin : changes_.take()) {
    const Coord2 tile(origin.head<2>());
    if (!changed.empty() && changed.back() == tile) continue;
    if (const auto kept = tiles_.find(plan_key(tile)); kept != tiles_.end())
      kept->second.is_new = false;
    changed.push_back(tile);
  }
  return changed;
}

}  // namespace soilvdb::inline v0
