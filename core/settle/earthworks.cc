// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/earthworks.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <utility>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/settle/collapse.h"

namespace soilvdb::inline v0 {
namespace {

int chunk_floor(int cell) { return cell & ~(kChunkSide - 1); }
int cell_of(double at) { return static_cast<int>(std::floor(at + 0.5)); }

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
    each(window, [&](const GroundWindow::Column& c, std::size_t, int, int) {
      if (c.known) zero = std::min(zero, c.bank);
    });
    each(window, [&](const GroundWindow::Column& c, std::size_t i, int x, int y) {
      columns.rigid[i] =
          !c.known || obstacle.blocks(window.first().x() + x, window.first().y() + y, c.top);
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

/// Does soil come to the border of the window, so that it may go on beyond?
bool at_border(const Deposit& deposit, const Columns& columns) {
  for (const Cone& cone : deposit.cones) {
    for (const RaisedColumn& c : cone.columns) {
      const int x = c.column / columns.ny, y = c.column % columns.ny;
      if (x == 0 || y == 0 || x == columns.nx - 1 || y == columns.ny - 1) return true;
    }
  }
  return false;
}

/// Splits samples among volumes, none made or lost by rounding.
class WholeSamples {
 public:
  explicit WholeSamples(double per_volume) : per_volume_(per_volume) {}
  std::int64_t next(double volume) {
    sum_ += volume * per_volume_;
    const std::int64_t before = given_;
    given_ = std::max(before, static_cast<std::int64_t>(std::llround(sum_)));
    return given_ - before;
  }

 private:
  double per_volume_, sum_ = 0;
  std::int64_t given_ = 0;
};

double minmod(double a, double b) {
  if (a * b <= 0) return 0;
  return std::abs(a) < std::abs(b) ? a : b;
}

/// Heights of a part of a window as collapse() takes them, in cells.
struct Slope {
  Coord2 first, size;  ///< in the window
  SoilColumns columns;

  Slope(const GroundWindow& window, const Eigen::AlignedBox2i& part, const Obstacle& obstacle)
      : first(part.min()), size(part.sizes() + Coord2::Ones()) {
    columns.nx = size.x();
    columns.ny = size.y();
    columns.side_m = 1;
    for (int y = 0; y < size.y(); ++y) {
      for (int x = 0; x < size.x(); ++x) {
        const Coord2 at = first + Coord2(x, y), cell = window.first() + at;
        const GroundWindow::Column& c = window.at(at.x(), at.y());
        columns.base_m.push_back(c.bank);
        columns.top_m.push_back(c.top);
        columns.missing.push_back(!c.known || obstacle.blocks(cell.x(), cell.y(), c.top));
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
Eigen::AlignedBox2i steep_part(const GroundWindow& window, const Obstacle& obstacle, double slope) {
  Eigen::AlignedBox2i box;
  const auto drop = [&](const GroundWindow::Column& from, int x, int y) {
    if (x < 0 || y < 0 || x >= window.nx() || y >= window.ny()) return 0.0;
    const GroundWindow::Column& to = window.at(x, y);
    if (!to.known || from.top <= to.top) return 0.0;
    const Coord2 cell = window.first() + Coord2(x, y);
    if (obstacle.blocks(cell.x(), cell.y(), to.top)) return 0.0;
    // Over a brink: what a slope drops across a column stays on it.
    return from.top - std::max(to.top, from.bank);
  };
  for (int x = 0; x < window.nx(); ++x) {
    for (int y = 0; y < window.ny(); ++y) {
      const GroundWindow::Column& c = window.at(x, y);
      if (!c.known || c.top - c.bank < kFilm) continue;
      const auto steep = [&](int far, double noise) {
        const double along_x = std::max(drop(c, x - far, y), drop(c, x + far, y));
        const double along_y = std::max(drop(c, x, y - far), drop(c, x, y + far));
        const double most = far * slope + noise;
        return along_x * along_x + along_y * along_y > most * most;
      };
      if (steep(1, kSteepStep) || steep(kSteepColumns, kSteepDrop)) box.extend(Coord2(x, y));
    }
  }
  return box;
}

}  // namespace

Earthworks::Earthworks(Soil& soil, const SoilProperties& properties, std::vector<Hopper> hoppers)
    : soil_(soil),
      properties_(properties),
      hoppers_(std::move(hoppers)),
      units_(properties),
      // Rounded, as C libraries differ in the last bits.
      slope_(static_cast<float>(std::tan(properties.repose_rad))) {
  const auto require = [](bool good, const char* what) {
    if (!good) throw std::invalid_argument(what);
  };
  const SoilProperties& p = properties_;
  require(p.repose_rad > 0 && p.repose_rad < std::numbers::pi / 2,
          "the angle of repose must be above 0 and below pi / 2 rad");
  require(p.swell >= 0 && std::isfinite(p.swell), "swell must be 0 or more");
  require(p.density_kg_m3 > 0 && std::isfinite(p.density_kg_m3), "density must be above 0");
}

void Earthworks::drop(const Vec3& from_m, std::int64_t mass, double time_s,
                      const Obstacle& obstacle) {
  const auto takes = [&](const Hopper& hopper) {
    const bool there = std::isnan(time_s) || (time_s >= hopper.begin_s && time_s <= hopper.end_s);
    return there && hopper.box_m.contains(from_m.head<2>()) && from_m.z() >= hopper.top_m;
  };
  if (std::any_of(hoppers_.begin(), hoppers_.end(), takes)) {
    books_.hauled += mass;
    return;
  }
  books_.in_flight += mass;
  const std::int64_t samples = books_.in_flight / units_.loose;
  if (samples == 0) return;
  const Vec2 at = soil_.index_from_world(from_m).head<2>();
  const int most = kMostWindow / 2;
  for (int half = cone_radius(static_cast<double>(samples), slope_) + kWindowMargin;; half *= 2) {
    if (pour(at, std::min(half, most), samples, obstacle) || half >= most) return;
  }
}

/// Pours within a window. @return false if that is too small, and nothing was done
bool Earthworks::pour(const Vec2& at, int half, std::int64_t samples, const Obstacle& obstacle) {
  const Coord2 first(chunk_floor(cell_of(at.x()) - half), chunk_floor(cell_of(at.y()) - half));
  const int side = 2 * half + kChunkSide;
  const GroundWindow window(soil_, first, side, side);
  PourGround ground(window, obstacle);
  const auto source = ground.nearest_open(at + Vec2(0.5, 0.5) - first.cast<double>());
  const bool last = half >= kMostWindow / 2;
  if (!source) return last;
  const Deposit deposit =
      pourer_.pour(ground.columns, *source, static_cast<double>(samples) / 64, slope_);
  if (!last && (deposit.left_m3 > 0 || at_border(deposit, ground.columns))) return false;
  const std::int64_t added = raise(deposit, window, ground.zero, samples);
  books_.in_flight -= added * units_.loose;
  return true;
}

/// Makes what was poured samples. @param zero height that the pourer's are above, index space
/// @return how many found room
std::int64_t Earthworks::raise(const Deposit& deposit, const GroundWindow& window, double zero,
                               std::int64_t samples) {
  double whole = deposit.left_m3;
  for (const Cone& cone : deposit.cones) whole += cone.volume_m3;
  WholeSamples share(static_cast<double>(samples) / whole);
  std::int64_t added = 0;
  std::vector<ColumnChange> changes;
  for (const Cone& cone : deposit.cones) {  // a column may be raised by several
    changes.clear();
    for (const RaisedColumn& c : cone.columns) {
      const int x = c.column / window.ny(), y = c.column % window.ny();
      changes.push_back({window.first() + Coord2(x, y), window.at(x, y).full + 1,
                         cell_of(zero + c.after_m) + kFillCells, share.next(c.after_m - c.before_m),
                         true, static_cast<float>(c.from_m.x() - x),
                         static_cast<float>(c.from_m.y() - y)});
    }
    added += add_loose(soil_, changes, slope_);
  }
  books_.fill_samples += added;
  return added;
}

void Earthworks::settle(const Eigen::AlignedBox2d& around_m, const Obstacle& obstacle) {
  if (around_m.isEmpty()) return;
  const Vec2 low = (around_m.min() - soil_.origin().head<2>()) / soil_.voxel_size_m();
  const Vec2 high = (around_m.max() - soil_.origin().head<2>()) / soil_.voxel_size_m();
  for (int margin = kWindowMargin;; margin *= 2) {
    const Coord2 first(chunk_floor(cell_of(low.x()) - margin),
                       chunk_floor(cell_of(low.y()) - margin));
    const Coord2 end(chunk_floor(cell_of(high.x()) + margin) + kChunkSide,
                     chunk_floor(cell_of(high.y()) + margin) + kChunkSide);
    const Coord2 size = (end - first).cwiseMin(kMostWindow);
    const bool last = size != end - first;
    if (slide(first, size, obstacle, last) || last) return;
  }
}

/// Lets what is too steep in a window slide. @param last whatever comes to its border
/// @return false if the window is too small, and nothing was done
bool Earthworks::slide(const Coord2& first, const Coord2& size, const Obstacle& obstacle,
                       bool last) {
  const GroundWindow window(soil_, first, size.x(), size.y());
  if (!window.has_loose()) return true;
  if (window.has_hanging() && fall(window, obstacle)) return slide(first, size, obstacle, last);
  const Eigen::AlignedBox2i steep = steep_part(window, obstacle, slope_);
  if (steep.isEmpty()) return true;
  const Eigen::AlignedBox2i whole(Coord2(0, 0), size - Coord2::Ones());
  for (int margin = kWindowMargin;; margin *= 2) {
    const Coord2 wide = Coord2::Constant(margin);
    const Eigen::AlignedBox2i around(steep.min() - wide, steep.max() + wide);
    const Eigen::AlignedBox2i part = whole.intersection(around);
    const Slope before(window, part, obstacle);
    const Collapse after = collapse(before.columns, {slope_ + kNoiseSlope, 1 + properties_.swell});
    if (after.iterations == 0) return true;
    if (after.at_edge && !whole.contains(around) && !last) return false;
    if (after.at_edge && part.sizes() != whole.sizes()) continue;
    move(window, before.first, before.columns, after);
    return true;
  }
}

/// Loose soil that nothing is under falls straight down. @return whether some did
bool Earthworks::fall(const GroundWindow& window, const Obstacle& obstacle) {
  std::vector<ColumnChange> from, to;
  for (int x = 0; x < window.nx(); ++x) {
    for (int y = 0; y < window.ny(); ++y) {
      const GroundWindow::Column& c = window.at(x, y);
      const Coord2 cell = window.first() + Coord2(x, y);
      if (c.hangs == 0 || obstacle.blocks(cell.x(), cell.y(), c.top)) continue;
      from.push_back({cell, c.hangs_low, c.hangs_high, c.hangs, false, 0, 0});
      to.push_back(from.back());
      to.back().low = c.bank_full + 1;
      to.back().high = c.hangs_low - 1;
    }
  }
  if (from.empty()) return false;
  const Taken taken = remove_top(soil_, from, slope_, false);
  const std::int64_t added = add_loose(soil_, to, slope_);
  books_.in_flight += (taken.loose - added) * units_.loose;
  books_.slid += taken.loose * units_.loose;
  books_.gone_samples += taken.loose;
  books_.fill_samples += added;
  return true;
}

/// Makes what collapsed samples.
void Earthworks::move(const GroundWindow& window, const Coord2& corner, const SoilColumns& before,
                      const Collapse& after) {
  const auto at = [&](int x, int y) { return static_cast<std::size_t>(y * before.nx + x); };
  std::vector<ColumnChange> lowered, raised;
  double rises = 0;
  for (int y = 0; y < before.ny; ++y) {
    for (int x = 0; x < before.nx; ++x) {
      const double now = after.top_m[at(x, y)], was = before.top_m[at(x, y)];
      if (before.missing[at(x, y)] != 0 || std::abs(now - was) < kLeastChange) continue;
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
      const auto samples = static_cast<std::int64_t>(std::llround(64 * (was - now)));
      if (falls && samples == 0) continue;
      if (!falls) rises += now - was;
      (falls ? lowered : raised)
          .push_back({window.first() + place, low, high, samples, false, static_cast<float>(a),
                      static_cast<float>(b)});
    }
  }
  const Taken taken = remove_top(soil_, lowered, slope_, false);
  const std::int64_t mass = taken.loose * units_.loose + taken.bank * units_.bank;
  books_.in_flight += mass;
  books_.slid += mass;
  books_.gone_samples += taken.loose + taken.bank;
  if (raised.empty()) return;
  WholeSamples share(static_cast<double>(books_.in_flight / units_.loose) / rises);
  for (ColumnChange& c : raised) {
    const Coord2 in_part = c.cell - window.first() - corner;
    const std::size_t i = at(in_part.x(), in_part.y());
    c.samples = share.next(after.top_m[i] - before.top_m[i]);
  }
  const std::int64_t added = add_loose(soil_, raised, slope_);
  books_.in_flight -= added * units_.loose;
  books_.fill_samples += added;
}

void Earthworks::save(std::string& out) const {
  for (const std::int64_t v :
       {books_.in_flight, books_.hauled, books_.slid, books_.fill_samples, books_.gone_samples})
    put(out, v);
}

void Earthworks::Books::load(std::string_view& in) {
  for (std::int64_t* v : {&in_flight, &hauled, &slid, &fill_samples, &gone_samples}) take(in, *v);
}

}  // namespace soilvdb::inline v0
