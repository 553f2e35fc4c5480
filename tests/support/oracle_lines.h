// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Lines through a sweep: how much swept soil lies on each. The oracle integrates over them.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "tests/support/oracle.h"

namespace soilvdb::test {

inline constexpr int kSteps = 256;         // of time, in which roots are looked for
inline constexpr int kBisections = 34;     // of one such step
inline constexpr int kGolden = 24;         // shrinks a step by 1e-5, an extreme's error by 1e-10
inline constexpr int kTerrainSteps = 48;   // along a range, to look for crossings of the terrain
inline constexpr double kParallel = 1e-9;  // cosine below which a line doesn't meet a plane
inline constexpr double kOut = -1e9;

inline std::vector<double> times_of(const Sweep& sweep) {
  std::vector<double> times(sweep.kinks);
  for (int i = 0; i <= kSteps; ++i) times.push_back(static_cast<double>(i) / kSteps);
  std::sort(times.begin(), times.end());
  times.erase(std::unique(times.begin(), times.end()), times.end());
  return times;
}

struct Line {
  Vec3 origin, direction;
};

/// Where a line meets a blade's plane, and how far inside the blade's edges (negative: outside).
struct Meeting {
  double s = 0, inside = kOut, cosine = 0;
};

inline Meeting meet(const Line& line, const Blade& blade, const Pose& world_from_blade) {
  const Eigen::Matrix3d axes = world_from_blade.rotation.toRotationMatrix();
  Meeting m;
  m.cosine = axes.col(0).dot(line.direction);
  if (std::abs(m.cosine) < kParallel) return m;
  m.s = axes.col(0).dot(world_from_blade.position - line.origin) / m.cosine;
  const Vec3 p = line.origin + m.s * line.direction - world_from_blade.position;
  const double y = axes.col(1).dot(p), z = axes.col(2).dot(p);
  m.inside = std::min({y - blade.y_low, blade.y_high - y, z, blade.z_high - z});
  return m;
}

using Range = std::pair<double, double>;

/// Lines of one direction through one sweep.
class Scan {
 public:
  Scan(const Sweep& sweep, const Terrain& terrain, const Vec3& direction)
      : sweep_(sweep),
        terrain_(terrain),
        direction_(direction.normalized()),
        times_(times_of(sweep)) {
    for (const Blade& blade : sweep.blades) {
      for (const double t : times_) {
        const Pose pose = sweep.world_from_bucket(t) * blade.bucket_from_blade;
        const Eigen::Matrix3d a = pose.rotation.toRotationMatrix();
        nodes_.push_back({a.col(0), a.col(1), a.col(2), a.col(0).dot(pose.position),
                          a.col(1).dot(pose.position), a.col(2).dot(pose.position),
                          a.col(0).dot(direction_), a.col(1).dot(direction_),
                          a.col(2).dot(direction_)});
      }
    }
  }

  /// Length of the swept soil on the line through `origin`.
  double length(const Vec3& origin) const {
    const Line line{origin, direction_};
    std::vector<Range> ranges;
    for (std::size_t b = 0; b < sweep_.blades.size(); ++b) add_ranges(line, b, ranges);
    std::sort(ranges.begin(), ranges.end());
    double sum = 0, reached = -std::numeric_limits<double>::infinity();
    for (const Range& r : ranges) {
      const double from = std::max(r.first, reached);
      if (r.second > from) sum += soil_between(line, from, r.second);
      reached = std::max(reached, r.second);
    }
    return sum;
  }

  /// Bounds of the sweep in the coordinates given by the columns of `axes`.
  Eigen::AlignedBox3d bounds(const Eigen::Matrix3d& axes) const {
    Eigen::AlignedBox3d box;
    for (const Blade& blade : sweep_.blades) {
      for (const double t : times_) {
        const Pose pose = sweep_.world_from_bucket(t) * blade.bucket_from_blade;
        for (const double y : {blade.y_low, blade.y_high}) {
          for (const double z : {0.0, blade.z_high}) {
            box.extend(axes.transpose() * (pose * Vec3(0, y, z)));
          }
        }
      }
    }
    const Vec3 margin = 1e-3 * box.sizes();  // for the bend of the path between the times
    return {box.min() - margin, box.max() + margin};
  }

 private:
  struct Node {
    Vec3 nx, ny, nz;
    double cx, cy, cz, dx, dy, dz;
  };

  Meeting exact(const Line& line, std::size_t b, double t) const {
    const Blade& blade = sweep_.blades[b];
    return meet(line, blade, sweep_.world_from_bucket(t) * blade.bucket_from_blade);
  }

  Meeting at_node(const Line& line, std::size_t b, std::size_t i) const {
    const Node& n = nodes_[b * times_.size() + i];
    const Blade& blade = sweep_.blades[b];
    Meeting m;
    m.cosine = n.dx;
    if (std::abs(n.dx) < kParallel) return m;
    m.s = (n.cx - n.nx.dot(line.origin)) / n.dx;
    const double y = n.ny.dot(line.origin) - n.cy + m.s * n.dy;
    const double z = n.nz.dot(line.origin) - n.cz + m.s * n.dz;
    m.inside = std::min({y - blade.y_low, blade.y_high - y, z, blade.z_high - z});
    return m;
  }

  /// The meeting at the last time, going from `in` to `out`, at which it is inside. A plane that
  /// turns through the line's direction leaves it by way of infinity, so there it is outside.
  Meeting edge(const Line& line, std::size_t b, double in, double out, Meeting last) const {
    for (int k = 0; k < kBisections; ++k) {
      const double mid = (in + out) / 2;
      const Meeting m = exact(line, b, mid);
      if (m.inside >= 0 && m.cosine * last.cosine > 0) {
        in = mid;
        last = m;
      } else {
        out = mid;
      }
    }
    return last;
  }

  /// The greatest (sign 1) or least (sign -1) s between two times.
  double extreme(const Line& line, std::size_t b, double from, double to, double sign) const {
    constexpr double kRatio = 0.6180339887498949;
    double best = -std::numeric_limits<double>::infinity();
    const auto value = [&](double t) {
      const Meeting m = exact(line, b, t);
      const double v = m.inside >= 0 ? sign * m.s : -std::numeric_limits<double>::infinity();
      best = std::max(best, v);
      return v;
    };
    double c = to - kRatio * (to - from), d = from + kRatio * (to - from);
    double vc = value(c), vd = value(d);
    for (int k = 0; k < kGolden; ++k) {
      if (vc > vd) {
        to = d, d = c, vd = vc;
        c = to - kRatio * (to - from), vc = value(c);
      } else {
        from = c, c = d, vc = vd;
        d = from + kRatio * (to - from), vd = value(d);
      }
    }
    return sign * best;
  }

  void add_ranges(const Line& line, std::size_t b, std::vector<Range>& ranges) const {
    Meeting before, here = at_node(line, b, 0);
    bool open = false;
    Range range;
    const auto extend = [&](double s) {
      range.first = std::min(range.first, s);
      range.second = std::max(range.second, s);
    };
    const auto start = [&](double s) {
      range = {s, s};
      open = true;
    };
    const auto finish = [&] {
      ranges.push_back(range);
      open = false;
    };
    if (here.inside >= 0) start(here.s);
    for (std::size_t i = 1; i < times_.size(); ++i) {
      const Meeting last2 = before;
      before = here;
      here = at_node(line, b, i);
      const bool was = before.inside >= 0, is = here.inside >= 0;
      const double t0 = times_[i - 1], t1 = times_[i];
      if (!was && !is) {
        add_glimpse(line, b, i, before, here, last2, ranges);
        continue;
      }
      if (was && is && before.cosine * here.cosine > 0) {
        extend(here.s);
        // A turn at the node between this step and the last one.
        if (i > 1 && last2.inside >= 0 && (before.s - last2.s) * (here.s - before.s) < 0) {
          extend(extreme(line, b, times_[i - 2], t1, before.s > here.s ? 1 : -1));
        }
        continue;
      }
      if (was) {
        const Meeting end = edge(line, b, t0, t1, before);
        extend(end.s);
        if (i > 1 && last2.inside >= 0 && (before.s - last2.s) * (end.s - before.s) < 0) {
          extend(extreme(line, b, times_[i - 2], t1, before.s > end.s ? 1 : -1));
        }
        finish();
      }
      if (is) {
        start(here.s);
        const Meeting begin = edge(line, b, t1, t0, here);
        extend(begin.s);
        // A turn just inside: compare with the direction in which it goes on.
        if (i + 1 < times_.size()) {
          const Meeting next = at_node(line, b, i + 1);
          if (next.inside >= 0 && (here.s - begin.s) * (next.s - here.s) < 0) {
            extend(extreme(line, b, t0, times_[i + 1], here.s > next.s ? 1 : -1));
          }
        }
      }
    }
    if (open) finish();
  }

  /// A range that begins and ends within the step up to node i. Looked for only where the changes
  /// around the step are steep enough for the line to have come inside.
  void add_glimpse(const Line& line, std::size_t b, std::size_t i, const Meeting& before,
                   const Meeting& here, const Meeting& last2, std::vector<Range>& ranges) const {
    double steepest = std::abs(here.inside - before.inside);
    if (i > 1) steepest = std::max(steepest, std::abs(before.inside - last2.inside));
    if (i + 1 < times_.size()) {
      steepest = std::max(steepest, std::abs(at_node(line, b, i + 1).inside - here.inside));
    }
    if (before.inside + here.inside + 1.5 * steepest <= 0) return;
    constexpr double kRatio = 0.6180339887498949;
    double from = times_[i - 1], to = times_[i];
    for (int k = 0; k < 2 * kGolden; ++k) {
      const double c = to - kRatio * (to - from), d = from + kRatio * (to - from);
      const Meeting mc = exact(line, b, c), md = exact(line, b, d);
      if (std::max(mc.inside, md.inside) >= 0) {
        const double in = mc.inside >= 0 ? c : d;
        const Meeting& peak = mc.inside >= 0 ? mc : md;
        const double s0 = edge(line, b, in, times_[i - 1], peak).s;
        const double s1 = edge(line, b, in, times_[i], peak).s;
        ranges.push_back({std::min({s0, s1, peak.s}), std::max({s0, s1, peak.s})});
        return;
      }
      (mc.inside > md.inside ? to : from) = mc.inside > md.inside ? d : c;
    }
  }

  double soil_between(const Line& line, double from, double to) const {
    const auto above = [&](double s) {
      const Vec3 p = line.origin + s * line.direction;
      return p.z() - terrain_.height(p.head<2>());
    };
    const int steps = terrain_.flat ? 1 : kTerrainSteps;
    double sum = 0, a = from, fa = above(a);
    for (int k = 1; k <= steps; ++k) {
      const double b = from + (to - from) * k / steps, fb = above(b);
      if (fa < 0 && fb < 0) sum += b - a;
      if ((fa < 0) != (fb < 0)) {
        double in = fa < 0 ? a : b, out = fa < 0 ? b : a;
        if (terrain_.flat) {
          in = a + (b - a) * fa / (fa - fb);
        } else {
          for (int i = 0; i < kBisections; ++i) {
            const double mid = (in + out) / 2;
            (above(mid) < 0 ? in : out) = mid;
          }
        }
        sum += std::abs(in - (fa < 0 ? a : b));
      }
      a = b;
      fa = fb;
    }
    return sum;
  }

  const Sweep& sweep_;
  const Terrain& terrain_;
  Vec3 direction_;
  std::vector<double> times_;
  std::vector<Node> nodes_;
};

}  // namespace soilvdb::test
