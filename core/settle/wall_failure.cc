// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/wall_failure.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bitset>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <tuple>
#include <utility>

#include "core/constants.h"

namespace soilvdb::inline v0 {
namespace {

constexpr double kHalfSector = std::numbers::pi / kSliceDirections;

/// Unit vectors. Rounded, as C libraries differ in the last bits.
const std::array<Vec2, kSliceDirections>& directions() {
  static const std::array<Vec2, kSliceDirections> all = [] {
    std::array<Vec2, kSliceDirections> made;
    for (std::size_t i = 0; i < kSliceDirections; ++i) {
      const double angle = 2 * kHalfSector * static_cast<double>(i);
      made[i] = {static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))};
    }
    return made;
  }();
  return all;
}

/// A plane along which a slice slides, along the slice's direction from the middle of its toe.
struct FailurePlane {
  double foot, end;  ///< where it begins and comes out
  double slope;
  double cohesion;  ///< that it needs, sides
};

/// Ground along a direction, from a column at the foot of a cut.
class Slice {
 public:
  Slice(const Columns& ground, int x, int y, const Vec2& direction, const BankStrength& strength)
      : ground_(ground), x_(x), y_(y), direction_(direction), strength_(strength) {}

  /// Bank rises from here more steeply than friction holds it, and it doesn't behind.
  bool is_foot() const {
    const auto next = heights(1), behind = heights(-1);
    if (!next || next->firm - zero() <= strength_.friction) return false;
    return !behind || zero() - behind->top <= strength_.friction;
  }

  /// Of a slice at whose toe a cut has its foot.
  /// @param most columns that a plane may go through, and sides that it may rise
  /// @param at_border set if the ground ends before it is known
  std::optional<FailurePlane> weakest(int most, bool& at_border) {
    read(most, at_border);
    if (highest_ <= strength_.least_height()) return std::nullopt;
    find_foot();
    return weakest_plane(most);
  }

 private:
  struct Heights {
    double firm, top;
  };
  /// So many sides along the direction: between columns where all around are there.
  std::optional<Heights> heights(int step) const {
    const Vec2 at = Vec2(x_, y_) + step * direction_;
    const int i = static_cast<int>(std::floor(at.x())), j = static_cast<int>(std::floor(at.y()));
    const double u = at.x() - i, v = at.y() - j;
    Heights sum{0, 0};
    for (const auto& [dx, dy, share] : {std::tuple(0, 0, (1 - u) * (1 - v)),
                                        {1, 0, u * (1 - v)},
                                        {0, 1, (1 - u) * v},
                                        {1, 1, u * v}}) {
      if (share == 0) continue;
      if (!ground_.open(i + dx, j + dy)) return nearest(at);
      const int column = ground_.index(i + dx, j + dy);
      sum.firm += share * ground_.firm_at(column);
      sum.top += share * ground_.at(column);
    }
    return sum;
  }
  std::optional<Heights> nearest(const Vec2& at) const {
    const int i = static_cast<int>(std::lround(at.x())), j = static_cast<int>(std::lround(at.y()));
    if (!ground_.open(i, j)) return std::nullopt;
    const int column = ground_.index(i, j);
    return Heights{ground_.firm_at(column), ground_.at(column)};
  }
  double zero() const { return ground_.at(ground_.index(x_, y_)); }
  double rise(int k) const { return rises_[static_cast<std::size_t>(k)]; }
  int last() const { return static_cast<int>(rises_.size()) - 1; }

  /// Reads as far as a plane might come out.
  void read(int most, bool& at_border) {
    rises_ = {0};
    weights_ = {0};
    for (int k = 1; k <= most; ++k) {
      const auto here = heights(k);
      if (!here) {
        const Vec2 at = Vec2(x_, y_) + k * direction_;
        const bool outside = !ground_.has(static_cast<int>(std::lround(at.x())),
                                          static_cast<int>(std::lround(at.y())));
        const int before = std::max(0, last() - kBorderRiseColumns);
        const bool rises = rise(last()) - rise(before) > strength_.friction * (last() - before);
        at_border = at_border || (outside && (rises || highest_ > strength_.least_height()));
        return;
      }
      const double firm = here->firm - zero(), top = here->top - zero();
      rises_.push_back(firm);
      weights_.push_back(firm + (top - firm) / strength_.swell);
      highest_ = std::max(highest_, weights_.back());
      // The wedge on a plane weighs less than the highest of it all along: flatter ones hold.
      const double flattest = strength_.friction + strength_.cohesion / highest_;
      if (k > 1 && firm <= flattest * (k - kMaxFootOffset)) return;
    }
  }

  /// Where the cut begins, to a fraction of a column: that of the ramp whose columns rise at the
  /// same mean place and with the same spread.
  void find_foot() {
    int face = 1;  // columns of it
    while (face < last() && rise(face + 1) - rise(face) > strength_.friction) ++face;
    double mean = 0, square = 0;
    for (int k = 1; k <= face; ++k) {
      const double share = (rise(k) - rise(k - 1)) / rise(face);
      mean += share * (k - 0.5);
      square += share * (k - 0.5) * (k - 0.5);
    }
    const double spread = std::max(0.0, square - mean * mean - kUprightSpread);
    foot_ = std::clamp(mean - std::sqrt(3 * spread), 0.0, kMaxFootOffset);
  }

  std::optional<FailurePlane> weakest_plane(int highest) const {
    std::optional<FailurePlane> weakest;
    // Else what is left of a wedge would fail, and so on, until it is as flat as friction holds.
    const bool cohesionless = strength_.least_height() < kMinCutHeight;
    double most = 0, weight = 0;
    double steepest = std::numeric_limits<double>::infinity();  // that is below all ground so far
    for (int k = 1; k < last(); ++k) {
      weight += weights_[static_cast<std::size_t>(k)];
      if (k - foot_ < kMinFootWay) continue;
      steepest = std::min(steepest, rise(k) / (k - foot_));
      const double end = k + 0.5, way = end - foot_;
      const double least = std::max(strength_.friction, rise(k + 1) / (k + 1 - foot_));
      if (steepest <= strength_.friction) break;
      if (least >= steepest) continue;  // it doesn't come out here
      const auto look = [&](double slope) {
        const double wedge = weight - slope / 2 * way * way;
        if (wedge < kMinWedge || slope * way > highest) return;
        const double needed = wedge * (slope - strength_.friction) / ((1 + slope * slope) * way);
        if (cohesionless ? weakest && slope >= weakest->slope : needed <= most) return;
        most = needed;
        weakest = FailurePlane{foot_, end, slope, needed};
      };
      if (rise(k) - rise(k + 1) <= kFallOff) {
        look(std::clamp((rise(k) + rise(k + 1)) / 2 / way, least, steepest));
      } else {
        for (int i = 1; i <= kSlicePlanes; ++i) look(least + (steepest - least) * i / kSlicePlanes);
      }
    }
    return weakest;
  }

  const Columns& ground_;
  int x_, y_;
  Vec2 direction_;
  BankStrength strength_;
  std::vector<double> rises_, weights_;  // above the foot: of firm ground, as weight of bank
  double highest_ = 0, foot_ = 0;
};

/// The number of the direction in which wedges slide off a cut with its foot at a column, across
/// its face. A slice askew to an upright face needs the same cohesion, but behind the face's end it
/// would take the ground from behind what stands.
std::optional<int> across_face(const Columns& ground, int x, int y, const BankStrength& strength) {
  Vec2 uphill(0, 0);
  for (int i = -kFaceColumns; i <= kFaceColumns; ++i) {
    for (int j = -kFaceColumns; j <= kFaceColumns; ++j) {
      if (i * i + j * j > kFaceColumns * kFaceColumns || !ground.open(x + i, y + j)) continue;
      uphill +=
          (ground.firm_at(ground.index(x + i, y + j)) - ground.at(ground.index(x, y))) * Vec2(i, j);
    }
  }
  // None where bank rises only aside: on the face itself.
  static const double aside = static_cast<float>(std::cos(2 * kHalfSector));
  double most = aside * uphill.norm();
  std::optional<int> across;
  for (int i = 0; i < kSliceDirections; ++i) {
    const Vec2& direction = directions()[static_cast<std::size_t>(i)];
    const double along = direction.dot(uphill);
    if (across ? along <= most : along < most) continue;
    if (!Slice(ground, x, y, direction, strength).is_foot()) continue;
    across = i;
    most = along;
  }
  return across;
}

using Directions = std::bitset<kSliceDirections>;

/// Adds the direction of a face, and those up to half-way to that of a face beside it, so that
/// their slices leave no gap.
void turn_towards(const std::optional<int>& face, const std::optional<int>& beside,
                  Directions& across) {
  constexpr int n = kSliceDirections;
  if (!face) return;
  across.set(static_cast<std::size_t>(*face));
  const int turn = beside ? (*beside - *face + n + n / 2) % n - n / 2 : 0;
  if (std::abs(turn) > n / 4) return;
  for (int k = 1; k <= std::abs(turn) / 2; ++k)
    across.set(static_cast<std::size_t>((*face + (turn > 0 ? k : n - k)) % n));
}

/// A column at the foot of a cut, and the weakest planes through it.
struct Foot {
  Coord2 at = Coord2::Zero();
  Directions across = {};
  int most = 0;  ///< columns that a plane may go through, and sides that it may rise
  std::vector<std::pair<std::size_t, FailurePlane>> planes;  ///< by number of the direction
  bool fails = false, at_border = false;

  void find_planes(const Columns& ground, const BankStrength& strength) {
    for (std::size_t i = 0; i < kSliceDirections; ++i) {
      if (!across[i]) continue;
      Slice slice(ground, at.x(), at.y(), directions()[i], strength);
      const auto plane = slice.weakest(most, at_border);
      if (!plane) continue;
      planes.emplace_back(i, *plane);
      fails = fails || plane->cohesion > strength.cohesion;
    }
  }
};

/// What stands between columns that fail, or that failed before and bear loose soil.
class Gaps {
 public:
  Gaps(const Columns& ground, const WallFailure& failure, const DugDepth& dug)
      : ground_(ground), failure_(failure), dug_(dug) {}

  /// How a column fails that does not by itself: as those on both sides of it.
  std::optional<WallFailure::Column> fill(const Coord2& at) const {
    std::optional<WallFailure::Column> highest;
    if (!ground_.open(at.x(), at.y()) || is_low(index(at))) return highest;
    for (const Coord2& step : {Coord2(1, 0), Coord2(0, 1), Coord2(1, 1), Coord2(1, -1)}) {
      const int ahead = nearest_low(at, step), behind = nearest_low(at, -step);
      if (ahead == 0 || behind == 0) continue;
      const int a = index(at + ahead * step), b = index(at - behind * step);
      if (!fails(a) && !fails(b)) continue;
      const double share = static_cast<double>(ahead) / (ahead + behind);
      const WallFailure::Column &from = of(a), &to = of(b);
      const double height = from.height + share * (to.height - from.height);
      if (!highest || height > highest->height)
        highest = {height, from.slope + share * (to.slope - from.slope)};
    }
    return highest;
  }

 private:
  int index(const Coord2& at) const { return ground_.index(at.x(), at.y()); }
  const WallFailure::Column& of(int c) const {
    return failure_.columns[static_cast<std::size_t>(c)];
  }
  bool fails(int c) const { return of(c).height < ground_.firm_at(c); }
  /// Debris on ground that was never dug is no failure's: it may lie at the foot of a cliff.
  bool is_low(int c) const {
    return fails(c) || (ground_.at(c) - ground_.firm_at(c) > kFilmDepth &&
                        dug_(c / ground_.ny, c % ground_.ny) > 0);
  }
  /// So many steps; 0: none is near.
  int nearest_low(const Coord2& from, const Coord2& step) const {
    for (int k = 1; k <= kGapColumns; ++k) {
      const Coord2 at = from + k * step;
      if (!ground_.open(at.x(), at.y())) return 0;
      if (is_low(index(at))) return k;
    }
    return 0;
  }

  const Columns& ground_;
  const WallFailure& failure_;
  const DugDepth& dug_;
};

/// Fails also what stands in gaps: slices of feet whose faces differ leave some, and a needle in a
/// gap does not stand.
void close_gaps(const Columns& ground, const DugDepth& dug, WallFailure& failure) {
  const Gaps gaps(ground, failure, dug);
  const Eigen::AlignedBox2i all = failure.failed;
  std::vector<std::pair<Coord2, WallFailure::Column>> closed;
  for (int x = all.min().x() - kGapColumns; x <= all.max().x() + kGapColumns; ++x)
    for (int y = all.min().y() - kGapColumns; y <= all.max().y() + kGapColumns; ++y)
      if (const auto column = gaps.fill({x, y})) closed.emplace_back(Coord2(x, y), *column);
  for (const auto& [at, column] : closed) {
    WallFailure::Column& here =
        failure.columns[static_cast<std::size_t>(ground.index(at.x(), at.y()))];
    if (column.height >= here.height) continue;
    here = column;
    failure.failed.extend(at);
  }
}

}  // namespace

double BankStrength::least_height() const {
  return 2 * cohesion * (friction + std::hypot(1, friction));
}

WallFailure find_wedge_failure(const Columns& ground, const Eigen::AlignedBox2i& feet,
                               const BankStrength& strength, const DugDepth& dug) {
  WallFailure failure;
  const auto lower = [&](int x, int y, const Vec2& direction, const FailurePlane& plane) {
    if (failure.columns.empty()) {
      for (std::size_t c = 0; c < ground.height_m.size(); ++c)
        failure.columns.push_back({ground.firm_at(static_cast<int>(c))});
    }
    const double zero = ground.at(ground.index(x, y));
    const int far = static_cast<int>(plane.end) + 1;
    // Of the foot's column as seen along the slice: those of a cut that runs askew leave no gaps.
    const double half_width = (std::abs(direction.x()) + std::abs(direction.y())) / 2;
    const double widest = std::max(half_width, plane.end * std::tan(kHalfSector));
    for (int i = std::max(0, x - far); i <= std::min(ground.nx - 1, x + far); ++i) {
      int first = std::max(0, y - far), last = std::min(ground.ny - 1, y + far);
      const double across = (i - x) * direction.y();
      if (std::abs(direction.x()) > 0.5) {  // only where it is near enough to the slice
        const double middle = across / direction.x(), wide = widest / std::abs(direction.x());
        first = std::max(first, y + static_cast<int>(std::floor(middle - wide)));
        last = std::min(last, y + static_cast<int>(std::ceil(middle + wide)));
      } else if (std::abs(across) > widest + far * std::abs(direction.x())) {
        continue;
      }
      for (int j = first; j <= last; ++j) {
        const Vec2 to(i - x, j - y);
        const double along = to.dot(direction);
        const double aside = std::abs(direction.x() * to.y() - direction.y() * to.x());
        if (along <= 0 || along > plane.end || !ground.open(i, j)) continue;
        if (aside > std::max(half_width, along * std::tan(kHalfSector))) continue;
        const double height = zero + plane.slope * std::max(0.0, along - plane.foot);
        WallFailure::Column& column = failure.columns[static_cast<std::size_t>(ground.index(i, j))];
        if (height >= column.height) continue;
        column = {height, plane.slope * direction};
        failure.failed.extend(Coord2(i, j));
      }
    }
  };
  const auto rises = [&](int x, int y) {
    const double zero = ground.at(ground.index(x, y));
    for (int i = x - 1; i <= x + 1; ++i)
      for (int j = y - 1; j <= y + 1; ++j)
        if (ground.open(i, j) && ground.firm_at(ground.index(i, j)) - zero > strength.friction)
          return true;
    return false;
  };
  const Coord2 size = feet.sizes() + Coord2::Ones();
  std::vector<std::optional<int>> faces(static_cast<std::size_t>(std::max(0, size.prod())));
  const auto of_foot = [&](int x, int y) {
    const Coord2 in = Coord2(x, y) - feet.min();
    const bool has = (in.array() >= 0).all() && (in.array() < size.array()).all();
    return has ? &faces[static_cast<std::size_t>(in.x() * size.y() + in.y())] : nullptr;
  };
  const auto each = [](std::size_t count, const auto& f) {
    if (count >= kParallelFeet) return tbb::parallel_for(std::size_t{0}, count, f);
    for (std::size_t n = 0; n < count; ++n) f(n);
  };
  std::vector<Coord2> rising;
  for (int x = feet.min().x(); x <= feet.max().x(); ++x)
    for (int y = feet.min().y(); y <= feet.max().y(); ++y)
      if (ground.open(x, y) && rises(x, y)) rising.emplace_back(x, y);
  each(rising.size(), [&](std::size_t n) {
    const Coord2& at = rising[n];
    *of_foot(at.x(), at.y()) = across_face(ground, at.x(), at.y(), strength);
  });
  std::vector<Foot> all;
  for (const Coord2& at : rising) {
    Foot foot;
    foot.at = at;
    for (int i = at.x() - 1; i <= at.x() + 1; ++i)
      for (int j = at.y() - 1; j <= at.y() + 1; ++j)
        if (const auto* beside = of_foot(i, j))
          turn_towards(*of_foot(at.x(), at.y()), *beside, foot.across);
    if (foot.across.none()) continue;
    foot.most = static_cast<int>(kMaxPlaneDepths * dug(at.x(), at.y()));
    all.push_back(std::move(foot));
  }
  each(all.size(), [&](std::size_t n) { all[n].find_planes(ground, strength); });
  for (const Foot& foot : all) {
    failure.at_border = failure.at_border || foot.at_border;
    // Slices at different angles to a cut need the same but for what columns err by.
    for (const auto& [direction, plane] : foot.planes)
      if (foot.fails && plane.cohesion > kSameCohesionShare * strength.cohesion)
        lower(foot.at.x(), foot.at.y(), directions()[direction], plane);
  }
  if (!failure.failed.isEmpty()) close_gaps(ground, dug, failure);
  return failure;
}

}  // namespace soilvdb::inline v0
