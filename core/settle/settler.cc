// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/settler.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/lattice/chunk_math.h"
#include "core/settle/collapse.h"
#include "core/settle/whole_samples.h"

namespace soilvdb::inline v0 {
namespace {

double minmod(double a, double b) {
  if (a * b <= 0) return 0;
  return std::abs(a) < std::abs(b) ? a : b;
}

/// Heights of a part of a window as collapse() takes them, in cells.
struct Slope {
  Coord2 first, size;  ///< in the window
  SoilColumns columns;

  Slope(const GroundWindow& window, const Eigen::AlignedBox2i& part, const BlockedColumns& blocked)
      : first(part.min()), size(part.sizes() + Coord2::Ones()) {
    columns.nx = size.x();
    columns.ny = size.y();
    columns.side_m = 1;
    for (int y = 0; y < size.y(); ++y) {
      for (int x = 0; x < size.x(); ++x) {
        const Coord2 at = first + Coord2(x, y);
        const GroundWindow::Column& c = window.at(at.x(), at.y());
        columns.base_m.push_back(c.bank);
        columns.top_m.push_back(c.top);
        columns.missing.push_back(!c.known || blocked(at.x(), at.y()));
      }
    }
    columns.bank_m = columns.base_m;
  }
  std::size_t at(int x, int y) const { return static_cast<std::size_t>(y * size.x() + x); }
  bool there(int x, int y) const {
    return x >= 0 && y >= 0 && x < size.x() && y < size.y() && columns.missing[at(x, y)] == 0;
  }
};

/// Where loose soil is surely steeper than repose allows: a box of the window, empty if nowhere.
/// Between neighbours, what counts err by is a slope; over some columns it isn't.
Eigen::AlignedBox2i steep_part(const GroundWindow& window, const BlockedColumns& blocked,
                               double slope) {
  Eigen::AlignedBox2i box;
  const auto drop = [&](const GroundWindow::Column& from, int x, int y) {
    if (x < 0 || y < 0 || x >= window.nx() || y >= window.ny()) return 0.0;
    const GroundWindow::Column& to = window.at(x, y);
    if (!to.known || from.top <= to.top || blocked(x, y)) return 0.0;
    // Over a brink: what a slope drops across a column stays on it.
    return from.top - std::max(to.top, from.bank);
  };
  for (int x = 0; x < window.nx(); ++x) {
    for (int y = 0; y < window.ny(); ++y) {
      const GroundWindow::Column& c = window.at(x, y);
      if (!c.known || c.top - c.bank < kFilmDepth) continue;
      const auto steep = [&](int far, double noise) {
        const double along_x = std::max(drop(c, x - far, y), drop(c, x + far, y));
        const double along_y = std::max(drop(c, x, y - far), drop(c, x, y + far));
        const double most = far * slope + noise;
        return along_x * along_x + along_y * along_y > most * most;
      };
      if (steep(1, kSteepDropNext) || steep(kSteepFarColumns, kSteepDropFar))
        box.extend(Coord2(x, y));
    }
  }
  return box;
}

}  // namespace

Settler::Settler(Ground& ground, const SoilProperties& properties, std::vector<Hopper> hoppers)
    : ground_(ground),
      properties_(properties),
      hoppers_(std::move(hoppers)),
      units_(properties),
      // Rounded, as C libraries differ in the last bits.
      slope_(static_cast<float>(std::tan(properties.repose_rad))),
      base_(ground) {
  const SoilProperties& p = properties_;
  if (!p.cohesion_pa) return;
  const double friction_rad = p.friction_rad.value_or(p.repose_rad);
  const double friction = static_cast<float>(std::tan(friction_rad));
  const double cohesion = *p.cohesion_pa / (p.density_kg_m3 * kGravity * ground_.voxel_size_m());
  strength_ = BankStrength{cohesion, friction, 1 + p.swell};
  // What pulls it apart, by Mohr's circle: 2 c cos(phi) / (1 + sin(phi)).
  overhang_strength_ = {cohesion, 2 * cohesion / (3 * (friction + std::hypot(1, friction)))};
}

Settler::Settler(Ground& ground, const Settler& other)
    : ground_(ground),
      properties_(other.properties_),
      hoppers_(other.hoppers_),
      units_(other.units_),
      slope_(other.slope_),
      strength_(other.strength_),
      overhang_strength_(other.overhang_strength_),
      totals_(other.totals_),
      base_(ground, other.base_) {}

bool Settler::settle(const Eigen::AlignedBox3d& around_m, const Obstacle& obstacle,
                     bool bank_fails) {
  if (around_m.isEmpty()) return true;
  const Eigen::AlignedBox3i around(ground_.index_from_world(around_m.min()).unaryExpr(&cell_of),
                                   ground_.index_from_world(around_m.max()).unaryExpr(&cell_of));
  break_overhangs(around, obstacle);
  return settle_columns({Coord2(around.min().head<2>()), Coord2(around.max().head<2>())}, obstacle,
                        bank_fails);
}

/// Lets soil come to rest in and around columns of cells. @return whether all of it did
bool Settler::settle_columns(Eigen::AlignedBox2i changed, const Obstacle& obstacle,
                             bool bank_fails) {
  int axis;
  if (changed.sizes().maxCoeff(&axis) > kMaxWindowCells / 2) {
    Eigen::AlignedBox2i low = changed, high = changed;
    low.max()[axis] = changed.center()[axis];
    high.min()[axis] = low.max()[axis] + 1;
    const bool low_rests = settle_columns(low, obstacle, bank_fails);
    return settle_columns(high, obstacle, bank_fails) && low_rests;
  }
  int margin = kWindowMargin;
  for (int failures = 0, windows = 0; failures < kMaxBankFailures && windows < kMaxSlideWindows;) {
    const Coord2 wide = Coord2::Constant(margin);
    const Coord2 first = floor_to(changed.min() - wide, kChunkSide);
    const Coord2 end = floor_to(changed.max() + wide, kChunkSide) + Coord2::Constant(kChunkSide);
    const Coord2 size = end - first;
    const bool last = size.maxCoeff() >= kMaxWindowCells;
    std::optional<GroundWindow> window(std::in_place, base_, first, size.x(), size.y());
    const auto failed =
        strength_ && bank_fails ? fail(*window, changed, obstacle, last) : std::optional(false);
    if (failed.value_or(false)) window.emplace(base_, first, size.x(), size.y());
    Eigen::AlignedBox2i beyond;
    if (failed && slide(*window, obstacle, last, beyond)) {
      if (failed.value_or(false)) {
        ++failures;  // what is left may fail, too
      } else if (beyond.isEmpty()) {
        return true;
      } else {  // it slides on
        changed = beyond;
        margin = kWindowMargin;
        ++windows;
      }
    } else {
      margin *= 2;
    }
  }
  return false;
}

/// Lets what is too steep in a window slide. @param last whatever comes to its border
/// @param beyond columns at its border that got soil
/// @return false if the window is too small, and nothing was done
bool Settler::slide(const GroundWindow& window, const Obstacle& obstacle, bool last,
                    Eigen::AlignedBox2i& beyond) {
  if (!window.has_loose()) return true;
  const Coord2 size(window.nx(), window.ny());
  if (window.has_hanging() && fall(window, obstacle))
    return slide({base_, window.first(), size.x(), size.y()}, obstacle, last, beyond);
  const BlockedColumns blocked(window, obstacle);
  const Eigen::AlignedBox2i steep = steep_part(window, blocked, slope_);
  if (steep.isEmpty()) return true;
  const Eigen::AlignedBox2i whole(Coord2(0, 0), size - Coord2::Ones());
  for (int margin = kWindowMargin;; margin *= 2) {
    const Coord2 wide = Coord2::Constant(margin);
    const Eigen::AlignedBox2i around(steep.min() - wide, steep.max() + wide);
    const Eigen::AlignedBox2i part = whole.intersection(around);
    const Slope before(window, part, blocked);
    const Collapse after =
        collapse(before.columns, {slope_ + kRestSlopeMargin, 1 + properties_.swell});
    if (after.iterations == 0) return true;
    if (after.at_edge && !whole.contains(around) && !last) return false;
    if (after.at_edge && part.sizes() != whole.sizes()) continue;
    beyond = move(window, before.first, before.columns, after);
    return true;
  }
}

/// Loose soil that nothing is under falls straight down. @return whether some did
bool Settler::fall(const GroundWindow& window, const Obstacle& obstacle) {
  const BlockedColumns blocked(window, obstacle);
  std::vector<ColumnEdit> from, to;
  for (int x = 0; x < window.nx(); ++x) {
    for (int y = 0; y < window.ny(); ++y) {
      const GroundWindow::Column& c = window.at(x, y);
      const Coord2 cell = window.first() + Coord2(x, y);
      if (c.hangs == 0 || blocked(x, y)) continue;
      from.push_back({cell, c.hangs_low, c.hangs_high, c.hangs, false, 0, 0});
      to.push_back(from.back());
      to.back().low = c.bank_full + 1;  // up to its own top: it may be thicker than the gap
    }
  }
  if (from.empty()) return false;
  const Taken taken = remove_top(ground_, from, slope_, false);
  const std::int64_t added = add_loose(ground_, to, slope_);
  totals_.pending += (taken.loose - added) * units_.loose;
  totals_.slid += taken.loose * units_.loose;
  totals_.failed_samples += taken.loose;
  totals_.fill_samples += added;
  return true;
}

/// Makes what collapsed samples. @return columns at the window's border that got some
Eigen::AlignedBox2i Settler::move(const GroundWindow& window, const Coord2& corner,
                                  const SoilColumns& before, const Collapse& after) {
  const auto at = [&](int x, int y) { return static_cast<std::size_t>(y * before.nx + x); };
  std::vector<ColumnEdit> lowered, raised;
  double rises = 0;
  WholeSamples lost(64);
  for (int y = 0; y < before.ny; ++y) {
    for (int x = 0; x < before.nx; ++x) {
      const double now = after.top_m[at(x, y)], was = before.top_m[at(x, y)];
      if (before.missing[at(x, y)] != 0 || std::abs(now - was) < kMinHeightChange) continue;
      const auto rise = [&](int dx, int dy) {
        const int i = x + dx, j = y + dy;
        if (i < 0 || j < 0 || i >= before.nx || j >= before.ny || before.missing[at(i, j)] != 0)
          return 0.0;
        return after.top_m[at(i, j)] - now;
      };
      const double a = std::clamp(minmod(rise(1, 0), -rise(-1, 0)), -slope_, slope_);
      const double b = std::clamp(minmod(rise(0, 1), -rise(0, -1)), -slope_, slope_);
      const Coord2 place = corner + Coord2(x, y);
      const GroundWindow::Column& column = window.at(place.x(), place.y());
      const bool falls = now < was;
      const int low = (falls ? column.bank_full : column.full) + 1;
      const int high = cell_of(std::max(now, was)) + kFillCells;
      const std::int64_t samples = falls ? lost.next(was - now) : 0;
      if (falls && samples == 0) continue;
      if (!falls) rises += now - was;
      (falls ? lowered : raised)
          .push_back({window.first() + place, low, high, samples, false, static_cast<float>(a),
                      static_cast<float>(b)});
    }
  }
  const Taken taken = remove_top(ground_, lowered, slope_, false);
  const std::int64_t mass = taken.loose * units_.loose + taken.bank * units_.bank;
  totals_.pending += mass;
  totals_.slid += mass;
  totals_.failed_samples += taken.loose + taken.bank;
  Eigen::AlignedBox2i at_border;
  if (raised.empty()) return at_border;
  WholeSamples share(static_cast<double>(totals_.pending / units_.loose) / rises);
  for (ColumnEdit& c : raised) {
    const Coord2 in_part = c.cell - window.first() - corner;
    const std::size_t i = at(in_part.x(), in_part.y());
    const double rise = after.top_m[i] - before.top_m[i];
    c.samples = share.next(rise);
    const Coord2 to_border =
        (c.cell - window.first())
            .cwiseMin(window.first() + Coord2(window.nx(), window.ny()) - Coord2::Ones() - c.cell);
    if (to_border.minCoeff() == 0 && rise > kFilmDepth) at_border.extend(c.cell);
  }
  const std::int64_t added = add_loose(ground_, raised, slope_);
  totals_.pending -= added * units_.loose;
  totals_.fill_samples += added;
  return at_border;
}

void Settler::save(std::string& out) const {
  for (const std::int64_t v : {totals_.pending, totals_.hauled, totals_.lost_off_terrain,
                               totals_.slid, totals_.fill_samples, totals_.failed_samples})
    put(out, v);
}

void Settler::SettleTotals::load(std::string_view& in) {
  for (std::int64_t* v :
       {&pending, &hauled, &lost_off_terrain, &slid, &fill_samples, &failed_samples})
    take_amount(in, *v);
}

}  // namespace soilvdb::inline v0
