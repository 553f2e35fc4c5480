// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that falls onto ground given as samples.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "core/settle/settler.h"
#include "core/settle/whole_samples.h"

namespace soilvdb::inline v0 {
namespace {

/// Radius of a cone, cells.
double cone_radius(double samples, double slope) {
  return std::cbrt(3 * samples / (64 * std::numbers::pi * slope));
}

/// The nearest line ahead on which soil can lie that falls along one, or nothing. Of lines that
/// meet a tool `blocked` are passed. @param at_border is it looked for beyond the window?
std::optional<Vec2> nearest_rest(const Columns& columns, const Vec2& from, const Vec2& along,
                                 const Vec2& ahead, double slope, int blocked, bool& at_border) {
  const auto inside = [&](const Vec2& at) {
    return at.minCoeff() >= 0 && at.x() < columns.nx && at.y() < columns.ny;
  };
  for (int i = 0, open = kMaxLineSteps; open >= 0 && blocked >= 0; ++i) {
    const Vec2 at = from + i * kSourceStep * ahead;
    at_border = !inside(at) || !inside(at + along);
    if (at_border) break;
    const Pourer::Line line = Pourer::look_at_line(columns, at, along, slope);
    if (line == Pourer::Line::kRests) return at;
    --(line == Pourer::Line::kBlocked ? blocked : open);
    if (ahead == Vec2::Zero()) break;
  }
  return std::nullopt;
}

/// The nearest place to soil that falls, ahead of it if there is one; or nothing.
std::optional<Vec2> nearest_open(const Columns& columns, const Vec2& at, const Vec2& ahead) {
  const int x = static_cast<int>(std::floor(at.x())), y = static_cast<int>(std::floor(at.y()));
  if (columns.open(x, y)) return at;
  std::optional<Vec2> best;
  bool best_ahead = false;
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < columns.nx; ++i) {
    for (int j = 0; j < columns.ny; ++j) {
      if (!columns.open(i, j)) continue;
      const Vec2 middle(i + 0.5, j + 0.5), way = middle - at;
      const bool is_ahead = way.dot(ahead) >= 0;
      // Of places as near the one straight ahead, so that no direction of the grid decides.
      const double distance = way.squaredNorm() - kAheadShare * way.dot(ahead);
      if (is_ahead < best_ahead || (is_ahead == best_ahead && distance >= least)) continue;
      best_ahead = is_ahead;
      least = distance;
      best = middle;
    }
  }
  return best;
}

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

void Settler::drop(const Line& from_m, const Vec2& ahead, std::int64_t mass, double time_s,
                   float clearance) {
  clearance_ = clearance;
  // Where the line comes over a hopper or leaves it, as shares of its length.
  std::vector<double> ends = {0, 1};
  const auto at = [&](double share) { return Vec3(from_m[0] + share * (from_m[1] - from_m[0])); };
  const auto is_there = [&](const Hopper& hopper) {
    return std::isnan(time_s) || (time_s >= hopper.begin_s && time_s <= hopper.end_s);
  };
  const bool is_line = from_m[0] != from_m[1];
  for (const Hopper& hopper : hoppers_) {
    if (!is_line || !is_there(hopper)) continue;
    for (int axis = 0; axis < 2; ++axis) {
      for (const double side : {hopper.box_m.min()[axis], hopper.box_m.max()[axis]}) {
        const double share = (side - from_m[0][axis]) / (from_m[1][axis] - from_m[0][axis]);
        if (share > 0 && share < 1) ends.push_back(share);
      }
    }
  }
  std::sort(ends.begin(), ends.end());
  std::int64_t gone = 0;
  for (std::size_t i = 0; i + 1 < ends.size(); ++i) {
    if (ends[i] == ends[i + 1]) continue;
    const Vec3 middle = at((ends[i] + ends[i + 1]) / 2);
    const auto takes = [&](const Hopper& hopper) {
      return is_there(hopper) && hopper.box_m.contains(middle.head<2>()) &&
             middle.z() >= hopper.top_m;
    };
    const std::int64_t until =
        i + 2 == ends.size() ? mass : std::llround(ends[i + 1] * static_cast<double>(mass));
    const std::int64_t part = until - gone;
    gone = until;
    if (std::any_of(hoppers_.begin(), hoppers_.end(), takes))
      totals_.hauled += part;
    else
      pour_line({at(ends[i]), at(ends[i + 1])}, ahead, part);
  }
}

float Settler::clearance(std::int64_t mass) const {
  const double height = slope_ * cone_radius(2 * units_.loose_samples(mass), slope_);
  return std::max(kObstacleClearance, static_cast<float>(height));
}

double Settler::reach_m(const Vec3& at_m, float clearance) {
  refresh();
  const int cells = heap_radius(ground_.index_from_world(at_m).head<2>());
  return ground_.voxel_size_m() * (cells + clearance / slope_);
}

/// Pours along a line: a ridge where soil can lie so, else a few heaps.
void Settler::pour_line(const Line& from_m, Vec2 ahead, std::int64_t mass) {
  if (ahead != Vec2::Zero()) ahead.normalize();
  const Vec2 from = ground_.index_from_world(from_m[0]).head<2>();
  const Vec2 along = ground_.index_from_world(from_m[1]).head<2>() - from;
  const double length = along.norm();
  if (length > kMinLineCells && totals_.pending + mass >= units_.loose) {
    totals_.pending += mass;
    if (pour_pending(from, along, ahead)) return;
    totals_.pending -= mass;
  }
  const int heaps =
      std::clamp(static_cast<int>(std::ceil(length / kLineHeapCells)), 1, kMaxLineHeaps);
  for (int i = 0; i < heaps; ++i) {
    totals_.pending += mass * (i + 1) / heaps - mass * i / heaps;
    pour_pending(from + (i + 0.5) / heaps * along, Vec2::Zero(), ahead);
  }
}

/// Pours what is pending at a place, or along a line. @return false if it can't lie there
bool Settler::pour_pending(Vec2 at, Vec2 along, const Vec2& ahead) {
  const std::int64_t samples = totals_.pending / units_.loose;
  if (samples == 0) return true;
  constexpr int kMaxHalf = kMaxWindowCells / 2;
  const int radius = static_cast<int>(cone_radius(static_cast<double>(samples), slope_)) + 1;
  const int wide = kRunOnRadii * (radius + kWindowMargin);
  refresh();
  int half = radius + kPourMargin + heap_radius(at + along / 2);
  if (along != Vec2::Zero())
    half += static_cast<int>(along.norm() / 2 + kMaxLineSteps * kSourceStep);
  bool has_run = along != Vec2::Zero();
  for (int windows = 0; windows < kMaxPourWindows; ++windows) {
    if (totals_.pending < units_.loose) return true;
    const Vec2 before = at;
    switch (pour_in_window(at, along, ahead, std::min(half, kMaxHalf), has_run, half >= wide)) {
      case Poured::kNowhere:
        return false;
      case Poured::kNeedsRoom:
        half *= 2;
        break;
      case Poured::kLies:
        return true;
      case Poured::kRunsOn:
        if (at == before) return true;
        along.setZero();
        [[fallthrough]];
      case Poured::kRunsDown:
        run_down(at, radius);
        has_run = true;
        half = wide;
    }
  }
  pour_in_window(at, along, ahead, kMaxHalf, true, false);  // it lies at the border
  return true;
}

/// Follows soil down ground that is too steep for it, to so far above where it comes to rest that
/// its pile knows the slope; what finds no foot is lost.
void Settler::run_down(Vec2& at, int radius) {
  constexpr int kMaxWindows = static_cast<int>(4 * kMaxRunCells / kRunWindowCells);
  std::vector<Vec2> way = {at};
  Vec2 ahead = Vec2::Zero();
  for (bool ends = false; !ends;) {
    const Vec2 from = way.back();
    Vec2 to = from;
    // Where it seems to end in the small window it may go on in the wide one: what is a little too
    // steep is so only over some columns.
    for (const int side : {kRunWindowCells, kRunEndCells}) {
      const Vec2 centre = side == kRunWindowCells ? Vec2(from + side / 2 * ahead) : from;
      const Coord2 first =
          floor_to(centre.unaryExpr(&cell_of) - Coord2::Constant(side / 2), kChunkSide);
      look_at(first, Coord2::Constant(side + kChunkSide));
      const Vec2 corner = first.cast<double>() - Vec2(0.5, 0.5), in = from - corner;
      const Pourer::Foot foot = pourer_.foot(window_.columns, in, slope_);
      to = foot.at_m == in ? from : Vec2(foot.at_m + corner);
      ends = !foot.at_border;
      if (!ends && to != from) break;
    }
    if (to == from) break;
    way.push_back(to);
    ahead = (to - from).normalized();  // it goes on so, mostly
    const bool far = (way.back() - at).norm() > kMaxRunCells || way.size() > kMaxWindows;
    if (ends || !far) continue;
    return lose_off_terrain(static_cast<double>(totals_.pending / units_.loose));
  }
  const Vec2 end = way.back();
  while (way.size() > 1 && (way.back() - end).norm() < radius + kWindowMargin) way.pop_back();
  at = way.back();
}

/// About how far the heap that lies at a place reaches: more soil spreads over all of it.
int Settler::heap_radius(const Vec2& at) {
  const Coord2 cell(cell_of(at.x()), cell_of(at.y()));
  const GroundColumn& column = columns_.column(cell);
  return std::min(kMaxWindowCells, static_cast<int>((column.top - column.bank) / slope_));
}

/// Pours what is pending within a window. @param at where soil falls, index space; then where it
/// runs on beyond the window, if it may. @param has_run it is at the foot of what it runs down
Settler::Poured Settler::pour_in_window(Vec2& at, const Vec2& along, const Vec2& ahead, int half,
                                        bool has_run, bool may_run_on) {
  const std::int64_t samples = totals_.pending / units_.loose;
  const Vec2 centre = at + along / 2;
  const Coord2 first = floor_to(centre.unaryExpr(&cell_of) - Coord2::Constant(half), kChunkSide);
  look_at(first, Coord2::Constant(2 * half + kChunkSide));
  Columns& ground = window_.columns;
  const Vec2 place = at + Vec2(0.5, 0.5) - first.cast<double>();
  double tools = 0;
  for (const Obstacle* wall : walls_)
    if (!wall->empty()) tools = std::max(tools, wall->cells().sizes().cast<double>().norm());
  const int blocked = kMaxLineSteps + static_cast<int>(tools / kSourceStep);
  bool at_border = false;
  const auto source = along == Vec2::Zero()
                          ? nearest_open(ground, place, ahead)
                          : nearest_rest(ground, place, along, ahead, slope_, blocked, at_border);
  const bool last = half >= kMaxWindowCells / 2;
  if (!source) {
    if (along != Vec2::Zero() && (last || !at_border)) return Poured::kNowhere;
    if (!last) return Poured::kNeedsRoom;
    lose_off_terrain(static_cast<double>(samples));
    return Poured::kLies;
  }
  if (!has_run && pourer_.foot(ground, *source, slope_).at_m != *source) return Poured::kRunsDown;
  const Deposit deposit =
      pourer_.pour(ground, *source, static_cast<double>(samples) / 64, slope_, may_run_on, along);
  const bool runs_on = deposit.exit_m.has_value();
  if (!last && deposit_at_border(deposit, ground)) return Poured::kNeedsRoom;
  if (!last && !runs_on && deposit.left_m3 > 0) return Poured::kNeedsRoom;
  apply_deposit(deposit, samples);
  if (!runs_on) {
    lose_off_terrain(64 * deposit.left_m3);
    return Poured::kLies;
  }
  at = *deposit.exit_m + first.cast<double>() - Vec2(0.5, 0.5);
  return Poured::kRunsOn;
}

/// Soil that finds no ground as far as is looked: it must not come down where something else falls.
void Settler::lose_off_terrain(double samples) {
  const std::int64_t mass =
      std::min<std::int64_t>(std::llround(samples), totals_.pending / units_.loose) * units_.loose;
  totals_.pending -= mass;
  totals_.lost_off_terrain += mass;
}

/// Makes what was poured in window_ samples.
void Settler::apply_deposit(const Deposit& deposit, std::int64_t samples) {
  double whole = deposit.left_m3;
  for (const Cone& cone : deposit.cones) whole += cone.volume_m3;
  WholeSamples share(static_cast<double>(samples) / whole);
  std::vector<ColumnEdit> changes;
  for (const Cone& cone : deposit.cones) {  // a column may be raised by several
    changes.clear();
    for (const RaisedColumn& c : cone.columns) {
      const Coord2 in(c.column / window_.columns.ny, c.column % window_.columns.ny);
      const Vec2 apex = c.from_m - in.cast<double>();
      changes.push_back({.cell = window_.first + in,
                         .low = window_.full[static_cast<std::size_t>(c.column)] + 1,
                         .high = cell_of(window_.zero + c.after_m) + kFillCells,
                         .samples = share.next(c.after_m - c.before_m),
                         .cone = true,
                         .a = static_cast<float>(apex.x()),
                         .b = static_cast<float>(apex.y())});
    }
    put_in(changes);
  }
}

}  // namespace soilvdb::inline v0
