// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/compare/changed_area.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/constants.h"

namespace soilvdb::inline v0 {
namespace {

constexpr int kSide = 8;
constexpr double kClear = kClearSigmas * kWorstCountError;

/// A unit square into which thickness that rises straight along `normal` reaches, from its farthest
/// corner on by `depth`.
class Wedge {
 public:
  /// @param ratio of its volume to the thickness `step` from the square's middle
  Wedge(double ratio, const Vec2& normal, double step) : normal_(normal) {
    const double across = normal.sum(), beyond = step - across / 2;
    double low = std::max(0.0, -beyond), high = across;
    for (int i = 0; i < kWedgeHalvings; ++i) {
      depth_ = (low + high) / 2;
      (integral(3) < ratio * (depth_ + beyond) ? low : high) = depth_;
    }
    run_ = depth_ + beyond;
  }
  double area() const { return integral(2); }
  /// From the place of thickness 0 to `step`.
  double run() const { return run_; }

 private:
  Vec2 normal_;
  double depth_ = 0, run_ = 0;

  double integral(int order) const {
    const auto power = [&](double d) { return std::pow(std::max(0.0, d), order); };
    return (power(depth_) - power(depth_ - normal_.x()) - power(depth_ - normal_.y()) +
            power(depth_ - normal_.sum())) /
           (normal_.prod() * (order == 2 ? 2 : 6));
  }
};

/// Eight by eight columns with those around them.
class Patch {
 public:
  Patch(const ColumnChanges& changes, const std::pair<int, int>& first) {
    for (int n = 0; n < 9; ++n) {
      const auto at =
          changes.find({first.first + (n / 3 - 1) * kSide, first.second + (n % 3 - 1) * kSide});
      around_[static_cast<std::size_t>(n)] = at == changes.end() ? nullptr : &at->second;
    }
  }

  double columns() const {
    double sum = 0;
    for (int n = 0; n < kSide * kSide; ++n) sum += covered(n / kSide, n % kSide);
    return sum;
  }

 private:
  std::array<const ChangedColumns*, 9> around_;

  const ColumnChange& at(int x, int y) const {
    static constexpr ColumnChange kNothing;
    const auto* part =
        around_[static_cast<std::size_t>((x + kSide) / kSide * 3 + (y + kSide) / kSide)];
    return part == nullptr ? kNothing : (*part)[static_cast<std::size_t>((x & 7) * 8 + (y & 7))];
  }
  bool inside(int x, int y) const {
    for (int n = 0; n < 9; ++n)
      if (!at(x + n / 3 - 1, y + n % 3 - 1).certain) return false;
    return true;
  }

  /// The covered share of a column.
  double covered(int x, int y) const {
    const double here = double{at(x, y).thick};
    if (here == 0) return 0;
    if (inside(x, y)) return 1;
    double near = 0, far = 0, most = 0;
    Vec2 inwards = Vec2::Zero(), offset = Vec2::Zero();
    int count = 0;
    for (int n = 0; n < 9; ++n) {
      const int dx = n / 3 - 1, dy = n % 3 - 1;
      const ColumnChange& next = at(x + dx, y + dy);
      if (!next.certain) continue;
      most = std::max(most, double{next.thick} / (next.wide > 0 ? double{next.wide} : 1));
      inwards += double{next.thick} * Vec2(dx, dy);
      if (at(x, y).certain && !inside(x + dx, y + dy)) continue;
      near += double{next.thick};
      far += double{at(x + 2 * dx, y + 2 * dy).thick};
      offset += Vec2(dx, dy);
      ++count;
    }
    if (count == 0) return most > 0 ? std::clamp(here / most, -1.0, 1.0) : 0;
    near /= count;
    far /= count;
    const double slope = far - near > kClear ? far - near : 0, edge = near - slope / 2;
    const Vec2 normal = inwards.normalized();
    const double step = std::max(0.5, normal.dot(offset) / count);
    const Wedge wedge(here / near, normal.cwiseAbs().cwiseMax(kMinWedgeNormal), step);
    if (slope / step > near / wedge.run() / 2) return wedge.area();
    const double left = std::max(0.0, edge * edge - 2 * slope * here);
    const double part = 2 * here / (edge + std::sqrt(left));
    return part < double{at(x, y).wide} - 2 * kClear ? wedge.area() : std::clamp(part, -1.0, 1.0);
  }
};

}  // namespace

ColumnChange changed_column(double thick, double most, int levels, bool certain) {
  const double wide = levels < kSteepLevels ? 0 : std::min(1.0, most);
  return {static_cast<float>(thick), static_cast<float>(wide), certain};
}

double changed_columns(const ColumnChanges& changes) {
  std::vector<std::pair<int, int>> firsts;
  for (const auto& [first, columns] : changes) firsts.push_back(first);
  std::vector<double> sums(firsts.size());
  tbb::parallel_for(std::size_t{0}, firsts.size(),
                    [&](std::size_t i) { sums[i] = Patch(changes, firsts[i]).columns(); });
  double sum = 0;
  for (const double part : sums) sum += part;
  return sum;
}

}  // namespace soilvdb::inline v0
