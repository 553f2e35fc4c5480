// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A ray over unit cells in plan. It leaps over squares of cells whose ground is surely below it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// Squares of 2^k cells, k = 0 to kRayLevels, in a block of kRaySide cells a side.
inline constexpr int kRayLevels = 6, kRaySide = 1 << kRayLevels;
/// First square of a level among all those of a block, from level `lowest` on; row x of a level
/// after row x - 1.
constexpr std::size_t ray_level_begin(int level, int lowest) {
  std::size_t begin = 0;
  for (int k = lowest; k < level; ++k) begin += std::size_t{1} << 2 * (kRayLevels - k);
  return begin;
}

/// Where a ray is in its walk: at t, in a cell, about to look at the square of a level around it.
struct RayPlace {
  int x, y, level;
  double t;
};

/// The point at t is begin + t * along; plan in cells, height in any unit.
class RayWalk {
 public:
  static constexpr double kNever = std::numeric_limits<double>::infinity();
  /// A ray that leaves its cell so slowly stands upright.
  static constexpr double kLeastPlan = 1e-18;
  /// Rounding there is as large as a cell.
  static constexpr double kFarthest = 1e15;

  RayWalk(const Vec3& begin, const Vec3& along) : begin_(begin), along_(along) {
    for (int a = 0; a < 2; ++a) {
      if (std::abs(along_[a]) < kLeastPlan) along_[a] = 0;
      inverse_[a] = along_[a] == 0 ? 0 : 1 / along_[a];
      ahead_[a] = along_[a] > 0 ? -1 : 0;
    }
    fall_ = along_.z() < 0 ? 1 / along_.z() : 0;
  }

  /// Narrows [from, to] to where the ray is over a rectangle. False if that is nowhere.
  bool clip(const Vec2& low, const Vec2& high, double& from, double& to) const {
    if (!(begin_.head<2>().cwiseAbs().maxCoeff() < kFarthest)) return false;
    for (int a = 0; a < 2; ++a) {
      if (along_[a] == 0) {
        if (begin_[a] < low[a] || begin_[a] > high[a]) return false;
        continue;
      }
      const double s = (low[a] - begin_[a]) * inverse_[a], t = (high[a] - begin_[a]) * inverse_[a];
      from = std::max(from, std::min(s, t));
      to = std::min(to, std::max(s, t));
    }
    return from <= to;
  }
  /// @param low, high the cells that are walked over
  void start(double from, const Coord2& low, const Coord2& high) {
    t_ = from;
    for (int a = 0; a < 2; ++a) {
      cell_[a] = cell_near(begin_[a] + from * along_[a], low[a], high[a]);
      last_[a] = high[a];
    }
  }

  void start(const RayPlace& at, const Coord2& high) {
    t_ = at.t;
    cell_[0] = at.x;
    cell_[1] = at.y;
    last_[0] = high.x();
    last_[1] = high.y();
  }
  static int cell_near(double at, int low, int high) {
    return static_cast<int>(
        std::clamp(std::floor(at), static_cast<double>(low), static_cast<double>(high)));
  }

  double t() const { return t_; }
  int x() const { return cell_[0]; }
  int y() const { return cell_[1]; }
  double height(double t) const { return begin_.z() + t * along_.z(); }
  /// Of the ray from here to `end`.
  double lowest(double end) const { return height(along_.z() < 0 ? end : t_); }
  /// Where it leaves the square of a level that it is in.
  double end(int level) const { return std::max(t_, std::min(border(0, level), border(1, level))); }
  /// Goes on to the cell beyond that square. @param end that of the level
  void leave(int level, double end) {
    if (border(0, level) <= border(1, level))
      leave_over<0>(level, end);
    else
      leave_over<1>(level, end);
    t_ = end;
  }
  /// Goes on to where it comes down to a height, in the square of a level that it is in.
  void fall_to(double height, int level) {
    const double t = (height - begin_.z()) * fall_;
    if (!(t > t_)) return;
    for (int a = 0; a < 2; ++a) place_in(a, level, t);
    t_ = t;
  }
  /// The first t from here to `end` at which the ray is at or below a patch that is bilinear over
  /// the cell; kNever without one, or if a corner is NaN.
  double meet(double z00, double z10, double z01, double z11, double end) const {
    const double u = begin_.x() + t_ * along_.x() - x(), v = begin_.y() + t_ * along_.y() - y();
    const double du = along_.x(), dv = along_.y();
    const double a = z10 - z00, b = z01 - z00, twist = z11 - z10 - b;
    const double gap = height(t_) - (z00 + a * u + (b + twist * u) * v);
    if (gap <= 0) return t_;
    const double rate = along_.z() - (a * du + b * dv + twist * (u * dv + v * du));
    const double bend = -twist * du * dv, square = rate * rate - 4 * bend * gap;
    if (square < 0) return kNever;
    const double root = std::sqrt(square);
    const double s = rate < 0   ? 2 * gap / (root - rate)
                     : bend < 0 ? (rate + root) / (-2 * bend)
                                : kNever;
    return t_ + s <= end ? t_ + s : kNever;
  }
  Vec3 at(double t) const { return begin_ + t * along_; }

 private:
  template <int kOver>
  void leave_over(int level, double end) {
    constexpr int kBeside = 1 - kOver;
    const int side = 1 << level;
    cell_[kOver] = ahead_[kOver] != 0 ? (cell_[kOver] & -side) + side : (cell_[kOver] & -side) - 1;
    place_in(kBeside, level, end);
  }
  /// The cell at t along an axis, in the square of a level that the ray is in.
  void place_in(int axis, int level, double t) {
    const int side = 1 << level, low = cell_[axis] & -side;
    // Inside the square it is positive, so that cutting off is rounding down.
    const double in = begin_[axis] + t * along_[axis] - low;
    // Along the last border it stays in the last cell.
    const double most = std::min(side, last_[axis] - low + 1) - 0.5;
    cell_[axis] = low + static_cast<int>(std::clamp(in, 0.0, most));
  }
  double border(int axis, int level) const {
    if (along_[axis] == 0) return kNever;
    const int side = 1 << level, low = cell_[axis] & -side;
    return (low + (side & ahead_[axis]) - begin_[axis]) * inverse_[axis];
  }

  Vec3 begin_, along_;
  double inverse_[2];
  double fall_;   // 1 / along z; 0 where it doesn't fall
  int ahead_[2];  // all bits where it rises
  int cell_[2] = {0, 0}, last_[2] = {0, 0};
  double t_ = 0;
};

}  // namespace soilvdb::inline v0
