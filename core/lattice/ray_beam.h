// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Neighbouring rays that walk together as long as they surely go the same way.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "core/lattice/ray_walk.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// All numbers from `low` to `high`. As rounding keeps order, a result's span holds the rounded
/// results for all operands.
struct Span {
  double low = RayWalk::kNever, high = -RayWalk::kNever;

  void extend(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
};
inline Span operator*(double a, const Span& b) {
  return a < 0 ? Span{a * b.high, a * b.low} : Span{a * b.low, a * b.high};
}
inline Span min(const Span& a, const Span& b) {
  return {std::min(a.low, b.low), std::min(a.high, b.high)};
}
inline Span max(const Span& a, const Span& b) {
  return {std::max(a.low, b.low), std::max(a.high, b.high)};
}

/// Rays from one point as one RayWalk: each member's result holds those of all their walks, to the
/// last bit.
class RayBeam {
 public:
  /// @param along of all rays, by axis
  RayBeam(const Vec3& begin, const std::array<Span, 3>& along)
      : begin_(begin),
        along_(along),
        inverse_{inverse(along[0]), inverse(along[1])},
        fall_(inverse(along[2])) {}

  /// Do they go one way along x and y, and down? Other rays don't walk together.
  bool is_narrow() const {
    return is_one_way(along_[0]) && is_one_way(along_[1]) &&
           along_[2].high <= -RayWalk::kLeastPlan &&
           begin_.cwiseAbs().maxCoeff() < RayWalk::kFarthest;
  }
  /// Where they come over a rectangle, and where they leave it.
  void clip(const Vec2& low, const Vec2& high, Span& from, Span& to) const {
    from = {0, 0};
    to = {RayWalk::kNever, RayWalk::kNever};
    for (std::size_t a = 0; a < 2; ++a) {
      const auto k = static_cast<Eigen::Index>(a);
      const Span s = (low[k] - begin_[k]) * inverse_[a], t = (high[k] - begin_[k]) * inverse_[a];
      from = max(from, min(s, t));
      to = min(to, max(s, t));
    }
  }
  void start(const Span& from, const Coord2& low, const Coord2& high) {
    t_ = from;
    for (std::size_t a = 0; a < 2; ++a) {
      const auto k = static_cast<Eigen::Index>(a);
      const Span in = place(a, from);
      low_[a] = RayWalk::cell_near(in.low, low[k], high[k]);
      high_[a] = RayWalk::cell_near(in.high, low[k], high[k]);
      last_[a] = high[k];
    }
  }
  const Span& t() const { return t_; }
  int x() const { return low_[0]; }
  int y() const { return low_[1]; }
  /// Are all in one square of a level?
  bool is_in_one(int level) const {
    return ((low_[0] ^ high_[0]) | (low_[1] ^ high_[1])) >> level == 0;
  }
  Span lowest(const Span& end) const {
    return {begin_.z() + end.high * along_[2].low, begin_.z() + end.low * along_[2].high};
  }
  Span border(std::size_t axis, int level) const {
    const int side = 1 << level, low = low_[axis] & -side;
    return (low + (along_[axis].low > 0 ? side : 0) - begin_[static_cast<Eigen::Index>(axis)]) *
           inverse_[axis];
  }
  void leave(std::size_t over, int level, const Span& end) {
    const int side = 1 << level, low = low_[over] & -side;
    place_in(1 - over, level, end);
    low_[over] = high_[over] = along_[over].low > 0 ? low + side : low - 1;
    t_ = end;
  }
  /// @param height by ray @return whether all surely fall
  bool fall_to(const Span& height, int level) {
    const Span fall = {((height.high - begin_.z()) * fall_).low,
                       ((height.low - begin_.z()) * fall_).high};
    if (!(fall.high > t_.low)) return false;
    const bool is_sure = fall.low > t_.high;
    const auto low = low_, high = high_;
    for (std::size_t a = 0; a < 2; ++a) {
      place_in(a, level, max(fall, t_));
      if (is_sure) continue;
      low_[a] = std::min(low_[a], low[a]);
      high_[a] = std::max(high_[a], high[a]);
    }
    t_ = max(fall, t_);
    return is_sure;
  }

 private:
  static Span inverse(const Span& s) { return {1 / s.high, 1 / s.low}; }
  static bool is_one_way(const Span& s) {
    return s.low >= RayWalk::kLeastPlan || s.high <= -RayWalk::kLeastPlan;
  }
  Span place(std::size_t axis, const Span& t) const {
    const Span& along = along_[axis];
    const double begin = begin_[static_cast<Eigen::Index>(axis)];
    return along.low < 0 ? Span{begin + t.high * along.low, begin + t.low * along.high}
                         : Span{begin + t.low * along.low, begin + t.high * along.high};
  }
  void place_in(std::size_t axis, int level, const Span& t) {
    const int side = 1 << level, low = low_[axis] & -side;
    const double most = std::min(side, last_[axis] - low + 1) - 0.5;
    const Span in = place(axis, t);
    low_[axis] = low + static_cast<int>(std::clamp(in.low - low, 0.0, most));
    high_[axis] = low + static_cast<int>(std::clamp(in.high - low, 0.0, most));
  }

  Vec3 begin_;
  std::array<Span, 3> along_;
  std::array<Span, 2> inverse_;
  Span fall_, t_;
  std::array<int, 2> low_ = {0, 0}, high_ = {0, 0}, last_ = {0, 0};
};

}  // namespace soilvdb::inline v0
