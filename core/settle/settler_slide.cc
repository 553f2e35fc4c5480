// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Loose soil that is too steep slides.
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/lattice/lanes.h"
#include "core/settle/brink.h"
#include "core/settle/settler.h"
#include "core/settle/whole_samples.h"

namespace soilvdb::inline v0 {
namespace {

double minmod(double a, double b) {
  if (a * b <= 0) return 0;
  return std::abs(a) < std::abs(b) ? a : b;
}

/// A tile and the columns that its slopes are measured over.
class Surroundings {
 public:
  Surroundings(GroundColumns& ground, const Coord2& tile, BlockedColumns& blocked, double slope)
      : slope_(static_cast<float>(slope)), has_loose_(ground.tile(tile.x(), tile.y()).has_loose) {
    if (!has_loose_) return;
    const Coord2 first = tile - Coord2::Constant(kFar);
    double zero = std::numeric_limits<double>::quiet_NaN();  // heights are floats above it
    ground.each({first, first + Coord2::Constant(kSide - 1)},
                [&](const Coord2& cell, const GroundColumn& column) {
                  if (!column.known || blocked(cell)) return;
                  if (std::isnan(zero)) zero = std::floor(column.bank);
                  const Coord2 in = cell - first;
                  const auto i = static_cast<std::size_t>(in.x() * kSide + in.y());
                  top_[i] = static_cast<float>(column.top - zero);
                  bank_[i] = static_cast<float>(column.bank - zero);
                  open_[i] = 1;
                });
  }

  /// Is loose soil surely steeper than repose allows? Between neighbours, what counts err by is a
  /// slope; over some columns it isn't.
  SOILVDB_FOR_CPUS bool is_steep() const {
    if (!has_loose_) return false;
    for (int x = kFar; x < kSide - kFar; ++x) {
      const int row = x * kSide + kFar;
      const LaneMask loose = open(row) & (lanes(top_, row) - lanes(bank_, row) >= kFilmDepth);
      if (bits(loose) == 0) continue;
      for (int far = 1; far <= kFar; ++far) {
        const float most =
            static_cast<float>(far) * slope_ + static_cast<float>(kSteepDrops[far - 1]);
        if (bits(loose & (steepest2(row, far) > most * most)) != 0) return true;
      }
    }
    return false;
  }

 private:
  static constexpr int kFar = kSteepColumns, kSide = kChunkSide + 2 * kFar;
  using Column = std::array<float, kSide * kSide>;

  SOILVDB_INLINE static Lanes lanes(const Column& column, int i) {
    return lanes_at(&column[static_cast<std::size_t>(i)]);
  }
  SOILVDB_INLINE LaneMask open(int i) const { return lanes(open_, i) > 0; }
  /// How far bank drops from columns to those at an offset.
  SOILVDB_INLINE Lanes bank_drop(int from, int to) const {
    return (open(from) & open(to)) ? lanes(bank_, from) - lanes(bank_, to) : Lanes{};
  }
  /// How far soil drops from eight columns to those at an offset. Over a brink, which it ends at,
  /// that is repose and as much more as lies there too deep.
  SOILVDB_INLINE Lanes drop(int from, int offset, int far) const {
    const int to = from + offset;
    const Lanes top = lanes(top_, from), bank = lanes(bank_, from), to_top = lanes(top_, to);
    Lanes end = max(to_top, bank);
    if (far == 1) {
      const Lanes held = held_at_brink(bank_drop(from - offset, from), bank - lanes(bank_, to),
                                       bank_drop(to, to + offset), slope_);
      end = to_top >= bank ? to_top : max(to_top, bank - slope_ + held);
    }
    return (open(from) & open(to) & (top > to_top)) ? top - end : Lanes{};
  }
  /// The squares of the largest drops over so many columns: along an axis, or down a square, as the
  /// mean of its opposite sides. Of a cone, one side of a square alone is steeper than its slope.
  SOILVDB_INLINE Lanes steepest2(int row, int far) const {
    Lanes most{};
    for (const int x : {-far * kSide, far * kSide}) {
      const Lanes along_x = drop(row, x, far);
      for (const int y : {-far, far}) {
        const Lanes along_y = drop(row, y, far);
        const Lanes down_x = along_x + drop(row + y, x, far);
        const Lanes down_y = along_y + drop(row + x, y, far);
        const Lanes square = (down_x * down_x + down_y * down_y) / 4;
        most = max(most, max(along_x * along_x, along_y * along_y));
        most = max(most, open(row + x + y) ? square : Lanes{});
      }
    }
    return most;
  }

  float slope_;
  bool has_loose_;
  Column top_{}, bank_{}, open_{};
};

/// Groups of tiles that are near each other.
std::vector<std::vector<Coord2>> steep_groups(const TileSet& tiles) {
  std::vector<std::vector<Coord2>> groups;
  TileSet left = tiles;
  tiles.each([&](const Coord2& first) {
    if (!left.has(first)) return;
    std::vector<Coord2> group;
    const auto take = [&](const Coord2& tile) {
      if (left.remove(tile)) group.push_back(tile);
    };
    take(first);
    for (std::size_t i = 0; i < group.size(); ++i)
      for (int x = -kNearTiles; x <= kNearTiles; ++x)
        for (int y = -kNearTiles; y <= kNearTiles; ++y) take(group[i] + kChunkSide * Coord2(x, y));
    groups.push_back(std::move(group));
  });
  return groups;
}

/// The change from which on columns are changed: of most on a slope it is less than a sample, which
/// takes long and shows nowhere, but what is left out must not be missed by the others.
/// @return infinity if heights err by more than anything changes
double least_change(std::span<const FluxGrid::Change> changes) {
  double least = kMaxHeightChangeLeft;
  for (; least > kMinHeightChange; least /= 4) {
    double fall = 0, rise = 0;
    int fallen = 0, risen = 0;
    for (const FluxGrid::Change& change : changes) {
      const double by = change.after - change.before;
      if (std::abs(by) < least) continue;
      (by < 0 ? fall : rise) += std::abs(by);
      ++(by < 0 ? fallen : risen);
    }
    if (least == kMaxHeightChangeLeft && fallen + risen == 0)
      return std::numeric_limits<double>::infinity();
    const double missed = std::abs(rise - fall);
    if (fall > 0 && rise > 0 &&
        (missed <= kMaxLeftOutShare * std::min(rise, fall) ||
         missed <= kMaxHeightMissed * (rise < fall ? risen : fallen)))
      break;
  }
  return std::max(least, kMinHeightChange);
}

}  // namespace

bool Settler::slide(TileSet& may_slide, int steps) {
  take_changes(may_slide);
  BlockedColumns walls = blocked();
  const auto in_wall = [&](const Coord2& cell, const GroundColumn&) { return walls(cell); };
  for (int pieces = 0; pieces < kMaxRestRounds && fall(may_slide, in_wall); ++pieces) {
    take_changes(may_slide);
    walls = blocked();
  }
  const TileSet steep = steep_tiles(may_slide, walls);
  may_slide.clear();
  for (const std::vector<Coord2>& group : steep_groups(steep)) {
    if (slide_from(group, walls, steps)) continue;
    for (const Coord2& tile : group) may_slide.add(tile);
  }
  take_changes(may_slide);
  return may_slide.empty();
}

/// The tiles in which or beside which loose soil is too steep, of those that changed and those
/// beside them.
TileSet Settler::steep_tiles(const TileSet& changed, BlockedColumns& blocked) {
  TileSet around, steep;
  changed.each([&](const Coord2& tile) {
    for (const auto& [x, y] : {std::pair(0, 0), {-1, 0}, {1, 0}, {0, -1}, {0, 1}})
      around.add(Coord2(tile + kChunkSide * Coord2(x, y)));
  });
  around.each([&](const Coord2& tile) {
    if (Surroundings(columns_, tile, blocked, slope_).is_steep()) steep.add(tile);
  });
  return steep;
}

/// @return whether all that slid is at rest
bool Settler::slide_from(std::span<const Coord2> tiles, BlockedColumns& blocked, int steps) {
  refresh();  // another group may have slid to here
  // Heights are floats above this, so that they are as exact wherever the site is.
  double zero = std::numeric_limits<double>::infinity();
  for (const Coord2& tile : tiles)
    for (const GroundColumn& c : columns_.tile(tile.x(), tile.y()).columns)
      if (c.known) zero = std::min(zero, std::floor(c.top));
  flux_.begin([&](const Coord2& tile, FluxTile& out) {
    const Coord2 corner = kChunkSide * tile;
    const ColumnTile& columns = columns_.tile(corner.x(), corner.y());
    for (int x = 0; x < kChunkSide; ++x) {
      for (int y = 0; y < kChunkSide; ++y) {
        const GroundColumn& c = columns.columns[static_cast<std::size_t>(kChunkSide * x + y)];
        const auto i = static_cast<std::size_t>(kChunkSide * y + x);
        if (!c.known || blocked(corner + Coord2(x, y)))
          out.set_missing(i);
        else
          out.set(i, c.bank - zero, 0, c.top - c.bank);
      }
    }
  });
  for (const Coord2& tile : tiles) flux_.activate(tile / kChunkSide);
  const int done = flux_.relax(steps);
  return done == 0 || !apply_slide(zero) || done < steps;
}

/// Loose soil falls within its column: what nothing is under, and what stands beside air because a
/// cut went through the column: of each column its lowest piece. @return whether some fell
bool Settler::fall(const TileSet& tiles, const Holds& holds) {
  std::vector<ColumnEdit> from, to;
  tiles.each([&](const Coord2& tile) {
    const ColumnTile& columns = columns_.tile(tile.x(), tile.y());
    if (!columns.has_loose) return;
    for (int i = 0; i < BaseColumn::kCells; ++i) {
      const GroundColumn& c = columns.columns[static_cast<std::size_t>(i)];
      const Coord2 cell = tile + Coord2(i / kChunkSide, i % kChunkSide);
      const bool stands = c.top - c.bank > kFilmDepth && c.surface - c.top > kMaxStandingCells;
      const bool hangs = c.hangs > 0;
      if (!c.known || !(hangs || stands) || holds(cell, c)) continue;
      // Up to its own top: what hangs may be thicker than the gap.
      const int high = cell_of(c.surface);
      from.push_back({.cell = cell,
                      .low = hangs ? c.hangs_low : cell_of(c.top) + 1,
                      .high = hangs ? c.hangs_high : high,
                      .samples = hangs ? c.hangs : ColumnEdit::kAll});
      to.push_back({.cell = cell, .low = (hangs ? c.bank_full : c.full) + 1, .high = high});
    }
  });
  if (from.empty()) return false;
  std::int64_t fell = 0;
  const std::vector<std::int64_t> by_column = let_slide(from);
  for (std::size_t i = 0; i < to.size(); ++i) fell += to[i].samples = by_column[i];
  if (fell > 0) put_in(to);
  return fell > 0;
}

/// Soil that hangs in columns that tools take, and lies on no tool, falls: a bucket is above it, or
/// around it. While the tool works, the next stroke would move it.
void Settler::fall_below_tools(TileSet& may_slide) {
  const auto holds = [&](const Coord2& cell, const GroundColumn& c) {
    return c.hangs == 0 || lies_on_tool(cell, c.top - static_cast<double>(c.hangs) / 64);
  };
  do take_changes(may_slide);
  while (fall(may_slide, holds));
}

/// Makes what slid samples. @param zero height that the solver's are above
/// @return whether it was more than heights err by
bool Settler::apply_slide(double zero) {
  std::vector<ColumnEdit> lowered, raised;
  std::vector<double> rises;
  double all_rises = 0;
  WholeSamples lost(64);
  const std::vector<FluxGrid::Change> changes = flux_.changes();
  const double least = least_change(changes);
  if (std::isinf(least)) return false;
  for (const FluxGrid::Change& change : changes) {
    const Coord2& cell = change.column;
    const double rise = change.after - change.before;
    if (std::abs(rise) < least) continue;
    const GroundColumn& column = columns_.column(cell);
    const double now = flux_.top(cell);
    const auto slope = [&](int dx, int dy) {
      const Coord2 step(dx, dy), next = cell + step, last = cell - step;
      const auto rises_to = [&](const Coord2& to) {
        return flux_.missing(to) ? 0.0 : flux_.top(to) - now;
      };
      return static_cast<float>(
          std::clamp(minmod(rises_to(next), -rises_to(last)), -slope_, slope_));
    };
    const bool falls = rise < 0;
    // A solver that has not come to rest may have given more than there is.
    const double highest = std::max(now + zero, column.top + rise);
    const std::int64_t samples = falls ? lost.next(-rise) : 0;
    if (falls && samples == 0) continue;
    (falls ? lowered : raised)
        .push_back({.cell = cell,
                    .low = (falls ? column.bank_full : column.full) + 1,
                    .high = cell_of(falls ? column.surface : highest) + (falls ? 0 : kFillCells),
                    .samples = samples,
                    .a = slope(1, 0),
                    .b = slope(0, 1)});
    if (falls) continue;
    rises.push_back(rise);
    all_rises += rise;
  }
  let_slide(lowered);
  WholeSamples share(static_cast<double>(totals_.pending / units_.loose) / all_rises);
  for (std::size_t i = 0; i < raised.size(); ++i) raised[i].samples = share.next(rises[i]);
  put_in(raised);
  return true;
}

}  // namespace soilvdb::inline v0
