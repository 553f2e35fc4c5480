// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that falls onto ground given as samples.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "core/settle/settler.h"
#include "core/settle/whole_samples.h"

namespace soilvdb::inline v0 {
namespace {

/// Cells along a cone's radius.
int cone_radius(double samples, double slope) {
  return static_cast<int>(std::cbrt(3 * samples / (64 * std::numbers::pi * slope))) + 1;
}

/// The ground of a window as the pourer sees it, in cells above the lowest.
struct PourGround {
  Columns columns;
  double zero = std::numeric_limits<double>::infinity();

  PourGround(const GroundWindow& window, const Obstacle& obstacle)
      : columns(window.nx(), window.ny(), 1) {
    columns.firm_m = columns.height_m;
    columns.rigid.assign(columns.height_m.size(), 0);
    const BlockedColumns blocked(window, obstacle);
    each(window, [&](const GroundWindow::Column& c, std::size_t, int, int) {
      if (c.known) zero = std::min(zero, c.bank);
    });
    each(window, [&](const GroundWindow::Column& c, std::size_t i, int x, int y) {
      columns.rigid[i] = !c.known || blocked(x, y);
      if (!c.known) return;
      columns.height_m[i] = c.top - zero;
      columns.firm_m[i] = c.bank - zero;
    });
  }
  template <typename F>
  void each(const GroundWindow& window, const F& f) const {
    for (int x = 0; x < window.nx(); ++x)
      for (int y = 0; y < window.ny(); ++y)
        f(window.at(x, y), static_cast<std::size_t>(columns.index(x, y)), x, y);
  }
  /// The nearest place to soil that falls, or nothing.
  std::optional<Vec2> nearest_open(const Vec2& at) const {
    const int x = static_cast<int>(std::floor(at.x())), y = static_cast<int>(std::floor(at.y()));
    if (columns.open(x, y)) return at;
    std::optional<Vec2> best;
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < columns.nx; ++i) {
      for (int j = 0; j < columns.ny; ++j) {
        const Vec2 middle(i + 0.5, j + 0.5);
        const double distance = (middle - at).squaredNorm();
        if (distance >= least || !columns.open(i, j)) continue;
        least = distance;
        best = middle;
      }
    }
    return best;
  }
};

/// Does a pile come to the border of the window, so that it may go on beyond?
bool deposit_at_border(const Deposit& deposit, const Columns& columns) {
  for (const Cone& cone : deposit.cones) {
    for (const RaisedColumn& c : cone.columns) {
      const int x = c.column / columns.ny, y = c.column % columns.ny;
      if (c.after_m - c.before_m < kFilmDepth) continue;
      if (x == 0 || y == 0 || x == columns.nx - 1 || y == columns.ny - 1) return true;
    }
  }
  return false;
}

}  // namespace

void Settler::drop(const Vec3& from_m, std::int64_t mass, double time_s, const Obstacle& obstacle) {
  const auto takes = [&](const Hopper& hopper) {
    const bool there = std::isnan(time_s) || (time_s >= hopper.begin_s && time_s <= hopper.end_s);
    return there && hopper.box_m.contains(from_m.head<2>()) && from_m.z() >= hopper.top_m;
  };
  if (std::any_of(hoppers_.begin(), hoppers_.end(), takes)) {
    totals_.hauled += mass;
    return;
  }
  totals_.pending += mass;
  const std::int64_t samples = totals_.pending / units_.loose;
  if (samples == 0) return;
  Vec2 at = ground_.index_from_world(from_m).head<2>();
  constexpr int kMaxHalf = kMaxWindowCells / 2;
  const int radius = cone_radius(static_cast<double>(samples), slope_);
  int half = radius + kPourMargin + heap_radius(at), most_run = kRunOnWindowCells / 2;
  for (int windows = 0; windows < kMaxPourWindows; ++windows) {
    const Vec2 before = at;
    if (!pour(at, std::min(half, kMaxHalf), half >= most_run, obstacle)) {
      half *= 2;
    } else if (at == before) {
      return;
    } else {
      half = most_run = kRunOnRadii * (radius + kWindowMargin);
    }
  }
  pour(at, kMaxHalf, false, obstacle);  // it lies at the border
}

/// About how far the heap that lies at a place reaches: more soil spreads over all of it.
int Settler::heap_radius(const Vec2& at) {
  const Coord2 cell(cell_of(at.x()), cell_of(at.y()));
  const GroundWindow::Column column = GroundWindow(base_, cell, 1, 1).at(0, 0);
  return std::min(kMaxWindowCells, static_cast<int>((column.top - column.bank) / slope_));
}

/// Pours what is in flight within a window. @param at where soil falls, index space; then where it
/// runs on beyond the window, if it may
/// @return false if the window is too small, and nothing was done
bool Settler::pour(Vec2& at, int half, bool may_run_on, const Obstacle& obstacle) {
  const std::int64_t samples = totals_.pending / units_.loose;
  const Coord2 first = floor_to(at.unaryExpr(&cell_of) - Coord2::Constant(half), kChunkSide);
  const int side = 2 * half + kChunkSide;
  const GroundWindow window(base_, first, side, side);
  PourGround ground(window, obstacle);
  const auto source = ground.nearest_open(at + Vec2(0.5, 0.5) - first.cast<double>());
  const bool last = half >= kMaxWindowCells / 2;
  if (!source) {
    if (last) lose_off_terrain(static_cast<double>(samples));
    return last;
  }
  const Deposit deposit =
      pourer_.pour(ground.columns, *source, static_cast<double>(samples) / 64, slope_, may_run_on);
  const bool runs_on = deposit.exit_m.has_value();
  if (!last && deposit_at_border(deposit, ground.columns)) return false;
  if (!last && !runs_on && deposit.left_m3 > 0) return false;
  const std::int64_t added = raise(deposit, window, ground.zero, samples);
  totals_.pending -= added * units_.loose;
  if (runs_on)
    at = *deposit.exit_m + first.cast<double>() - Vec2(0.5, 0.5);
  else
    lose_off_terrain(64 * deposit.left_m3);
  return true;
}

/// Soil that finds no ground as far as is looked: it must not come down where something else falls.
void Settler::lose_off_terrain(double samples) {
  const std::int64_t mass =
      std::min<std::int64_t>(std::llround(samples), totals_.pending / units_.loose) * units_.loose;
  totals_.pending -= mass;
  totals_.lost_off_terrain += mass;
}

/// Makes what was poured samples. @param zero height that the pourer's are above, index space
/// @return how many found room
std::int64_t Settler::raise(const Deposit& deposit, const GroundWindow& window, double zero,
                            std::int64_t samples) {
  double whole = deposit.left_m3;
  for (const Cone& cone : deposit.cones) whole += cone.volume_m3;
  WholeSamples share(static_cast<double>(samples) / whole);
  std::int64_t added = 0;
  std::vector<ColumnEdit> changes;
  for (const Cone& cone : deposit.cones) {  // a column may be raised by several
    changes.clear();
    for (const RaisedColumn& c : cone.columns) {
      const int x = c.column / window.ny(), y = c.column % window.ny();
      changes.push_back({window.first() + Coord2(x, y), window.at(x, y).full + 1,
                         cell_of(zero + c.after_m) + kFillCells, share.next(c.after_m - c.before_m),
                         true, static_cast<float>(c.from_m.x() - x),
                         static_cast<float>(c.from_m.y() - y)});
    }
    added += add_loose(ground_, changes, slope_);
  }
  totals_.fill_samples += added;
  return added;
}

}  // namespace soilvdb::inline v0
