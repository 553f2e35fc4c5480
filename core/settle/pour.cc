// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/pour.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/constants.h"
#include "core/settle/fall_line.h"
#include "core/settle/front.h"

namespace soilvdb::inline v0 {
namespace {

/// Is a column so near to the ground's border that so much soil might lean on it?
bool at_border(const Columns& ground, int column, double volume, double slope) {
  const int x = column / ground.ny, y = column % ground.ny;
  const int far = std::min({x, y, ground.nx - 1 - x, ground.ny - 1 - y});
  return far < kExitColumns + kExitPiles * std::cbrt(volume / slope);
}

}  // namespace

struct Pourer::Work {
  FrontFinder finder;
  FallLine way;
  Front low, high, tried;
  struct Before {
    std::uint32_t epoch = 0;
    double level;
  };
  std::vector<Before> before;
  std::uint32_t epoch = 0;

  Columns* ground = nullptr;
  double slope = 0, side = 0;

  enum Rest { kAll, kRunsOn, kFull };
  Rest settle(double volume, double cap, Source& lip, double& lip_level);
  Vec2 entrance(const Vec2& middle, const Anchor& from) const;
  bool runs_on(Source& lip, double& lip_level);
  double next_level(double volume, int n, bool bounded, bool creeps) const;
  double commit(const Front& front, double level, Deposit& deposit);
};

/// Where the straight way from an anchor comes into a column below: through which side, and where
/// soil runs over the edge there, if it only just does.
Vec2 Pourer::Work::entrance(const Vec2& middle, const Anchor& from) const {
  const Vec2 near = from.nearest(middle), back = near - middle;
  const int axis = std::abs(back.x()) > std::abs(back.y()) ? 0 : 1;
  const double far = std::abs(back[axis]);
  if (!(far > 0.5)) return near;
  const Vec2 straight = middle + back * (0.5 / far);
  Vec2 first = straight, above = middle;
  first[1 - axis] = std::clamp(near[1 - axis], middle[1 - axis] - 0.5, middle[1 - axis] + 0.5);
  above[axis] += back[axis] > 0 ? 1 : -1;
  double edge;
  if (!finder.step(static_cast<int>(above.x()), static_cast<int>(above.y()),
                   static_cast<int>(middle.x()), static_cast<int>(middle.y()), edge))
    return straight;
  const double there = high.level - slope * side * (from.distance + (first - near).norm());
  return there - edge < kMinEdgeCover * side ? first : straight;
}

/// Where soil that the low front doesn't hold runs on to in the high one: its first column that is
/// raised by more than noise from one to the other.
bool Pourer::Work::runs_on(Source& lip, double& lip_level) {
  before.resize(ground->height_m.size());
  if (++epoch == 0) {
    for (Before& b : before) b.epoch = 0;
    epoch = 1;
  }
  const double fall = slope * side, noise = kRunOnDrop * side, edge_noise = kEdgeRunOnDrop * side;
  for (const Front::Part& p : low.parts)
    before[static_cast<std::size_t>(p.column)] = {epoch, low.level - fall * p.distance};
  for (const Front::Part& p : high.parts) {
    const Before& b = before[static_cast<std::size_t>(p.column)];
    double was = ground->at(p.column);
    if (b.epoch == epoch) was = std::max(was, b.level);
    const double is = high.level - fall * p.distance;
    const Anchor& from = high.anchors[static_cast<std::size_t>(p.anchor)];
    if (is - was <= (from.lip ? edge_noise : noise) + (high.level - low.level)) continue;
    lip.column = p.column;
    lip.along.setZero();
    const Vec2 middle(p.column / ground->ny + 0.5, p.column % ground->ny + 0.5);
    lip.at = from.lip ? from.opens : entrance(middle, from);
    lip_level = is + fall * (middle - lip.at).norm();
    return true;
  }
  return false;
}

/// The next level to look at between the two fronts.
double Pourer::Work::next_level(double volume, int n, bool bounded, bool creeps) const {
  const double tolerance = kLevelTolerance * side;
  const double middle = (low.level + high.level) / 2;
  // Just below where a lip opens, then just above.
  if (low.lip > low.level && low.lip < (bounded ? high.level : kInfinity) && n % kBisectEvery == 0)
    return low.lip + (low.lip - low.level > tolerance ? -kLipStep : kLipStep) * side;
  if (!bounded) {
    const double more =
        (volume - low.filled) / std::max(1.0, static_cast<double>(low.parts.size()));
    return low.level + std::min(more, std::max(side, low.level - way.lowest()));
  }
  if (!high.whole || creeps) return middle;
  // Either is exact if the same columns are raised there, at the same distances.
  const auto parts = static_cast<double>(low.parts.size());
  for (const double level : {high.level_of(volume), low.level + (volume - low.filled) / parts})
    if (level > low.level && level < high.level) return level;
  return middle;
}

/// Finds the level at which the pile on the way holds the volume (in `low`), or up to which it does
/// before it runs over a lip, or is as high as what it runs down from.
Pourer::Work::Rest Pourer::Work::settle(double volume, double cap, Source& lip, double& lip_level) {
  const double tolerance = kLevelTolerance * side;
  if (cap < kInfinity) {
    finder.fill(way.at(cap), cap, volume, low);
    if (low.whole) return kFull;
  }
  low.clear();
  low.level = way.lowest();
  bool bounded = false;
  double level = low.level + tolerance, last_gap = kInfinity;
  if (way.upright() > way.lowest()) {
    finder.grow(way.at(way.lowest()), volume, way.upright(), low);
    if (low.fits) return kAll;
    level = low.level + kLipStep * side;
  }
  for (int n = 0; n < kMaxPourLevels; ++n) {
    finder.fill(way.at(level), level, kMaxFrontPours * volume, tried);
    const bool fits = tried.filled <= volume;
    const bool near =
        tried.whole && !tried.parts.empty() &&
        std::abs(tried.filled - volume) <= tolerance * static_cast<double>(tried.parts.size());
    std::swap(tried, fits ? low : high);
    bounded = bounded || !fits;
    const double gap = bounded ? high.level - low.level : kInfinity;
    const bool creeps = gap > kMaxRangeLeft * last_gap;
    last_gap = gap;
    if (near) {
      if (!fits) std::swap(low, high);
      low.level = low.level_of(volume);
      return kAll;
    }
    const bool jumps = high.whole && !(low.lip < high.level) && gap <= kJumpTolerance * side;
    if (jumps || gap <= tolerance) {
      bool on = runs_on(lip, lip_level);
      if (!on && !high.whole) {
        finder.fill(way.at(high.level), high.level, kInfinity, high);
        on = runs_on(lip, lip_level);
      }
      if (on && gap <= tolerance) return kRunsOn;
      if (!on) {
        std::swap(low, high);
        low.level = low.level_of(volume);
        return kAll;
      }
    }
    level = next_level(volume, n, bounded, creeps);
  }
  return kAll;
}

/// Raises the ground. @return what that took, in metres of a column.
double Pourer::Work::commit(const Front& front, double level, Deposit& deposit) {
  Cone cone;
  double raised = 0;
  for (const Front::Part& p : front.parts) {
    const double before_m = ground->at(p.column);
    const double after_m = level - slope * side * p.distance;
    if (!(after_m > before_m)) continue;
    raised += after_m - before_m;
    ground->at(p.column) = after_m;
    const Anchor& from = front.anchors[static_cast<std::size_t>(p.anchor)];
    const Vec2 middle(p.column / ground->ny + 0.5, p.column % ground->ny + 0.5);
    cone.columns.push_back({p.column, before_m, after_m, from.nearest(middle) * side});
  }
  cone.volume_m3 = raised * side * side;
  if (!cone.columns.empty()) deposit.cones.push_back(std::move(cone));
  return raised;
}

Pourer::Pourer() : work_(std::make_unique<Work>()) {}
Pourer::~Pourer() = default;
Pourer::Pourer(Pourer&&) noexcept = default;
Pourer& Pourer::operator=(Pourer&&) noexcept = default;

Deposit Pourer::pour(Columns& ground, const Vec2& source, double volume_m3, double slope,
                     bool leaves, const Vec2& along) {
  Deposit deposit;
  Work& w = *work_;
  w.ground = &ground;
  w.slope = slope;
  w.side = ground.side_m;
  const Vec2 at = source / ground.side_m;
  const bool inside = at.x() >= 0 && at.y() >= 0 && at.x() < ground.nx && at.y() < ground.ny;
  const int x = inside ? static_cast<int>(at.x()) : -1, y = inside ? static_cast<int>(at.y()) : -1;
  double left = volume_m3 / (ground.side_m * ground.side_m);
  if (!ground.open(x, y)) {
    deposit.left_m3 = volume_m3;
    return deposit;
  }
  if (!(left > 0)) return deposit;
  const Source top{at, ground.index(x, y), along / ground.side_m};
  Source from = top;
  double level = kInfinity;  // of the soil that falls: at first it comes from above
  for (int n = 0; n < kMaxPourPiles && left > 0; ++n) {
    w.finder.look_at(ground, slope);
    w.way.find(w.finder, ground, slope, from, level);
    Source lip = w.way.end();
    if (leaves && !from.is_line() && lip.column != from.column &&
        at_border(ground, lip.column, left, slope)) {
      deposit.exit_m = lip.at * ground.side_m;
      break;
    }
    const auto rest = w.settle(left, level, lip, level);
    const double raised = w.commit(w.low, w.low.level, deposit);
    if (rest == Work::kAll) return deposit;
    left -= raised;
    if (leaves && rest == Work::kRunsOn && at_border(ground, lip.column, left, slope)) {
      deposit.exit_m = lip.at * ground.side_m;
      break;
    }
    // The rest raises both: again from above.
    from = rest == Work::kFull ? top : lip;
    if (rest == Work::kFull) level = kInfinity;
  }
  deposit.left_m3 = left * ground.side_m * ground.side_m;
  return deposit;
}

Pourer::Foot Pourer::foot(const Columns& ground, const Vec2& source, double slope) {
  const Vec2 at = source / ground.side_m;
  const int x = static_cast<int>(std::floor(at.x())), y = static_cast<int>(std::floor(at.y()));
  if (!ground.open(x, y)) return {source};
  Work& w = *work_;
  w.finder.look_at(ground, slope);
  w.way.find(w.finder, ground, slope, {at, ground.index(x, y)}, kInfinity);
  const Source end = w.way.end();
  return {end.at * ground.side_m, at_border(ground, end.column, 0, slope)};
}

Pourer::Line Pourer::look_at_line(const Columns& ground, const Vec2& source, const Vec2& along,
                                  double slope) {
  const int steps = static_cast<int>(std::ceil(along.norm() / (kSourceStep * ground.side_m)));
  double beyond = 0;  // repose: the mean decides, as some column of a heap is always too steep
  for (int i = 0; i <= steps; ++i) {
    const Vec2 at =
        (source + along * (static_cast<double>(i) / std::max(steps, 1))) / ground.side_m;
    const int x = static_cast<int>(std::floor(at.x())), y = static_cast<int>(std::floor(at.y()));
    if (!ground.open(x, y)) return Line::kBlocked;
    const double here = ground.at(ground.index(x, y));
    double most = 0;
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        if (!ground.open(x + dx, y + dy)) continue;
        const double fall = here - ground.at(ground.index(x + dx, y + dy));
        most = std::max(most, fall - slope * std::hypot(dx, dy) * ground.side_m);
      }
    }
    beyond += most;
  }
  return beyond <= kRunOnDrop * ground.side_m * (steps + 1) ? Line::kRests : Line::kTooSteep;
}

}  // namespace soilvdb::inline v0
