// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tests/support/oracle.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/support/oracle_lines.h"

namespace soilvdb::test {
namespace {

constexpr int kLines = 28657, kLinesBefore = 17711;  // consecutive Fibonacci numbers

/// Mean of `f(i)` over 0 <= i < n, the same for any number of threads.
template <typename F>
double mean(int n, const F& f) {
  std::vector<double> values(static_cast<std::size_t>(n));
  tbb::parallel_for(0, n, [&](int i) { values[static_cast<std::size_t>(i)] = f(i); });
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / n;
}

}  // namespace

Blade mouth(const Bucket& bucket) {
  return {{}, -bucket.width_m / 2, bucket.width_m / 2, bucket.height_m};
}

std::vector<Blade> profile_faces(const Bucket& bucket) {
  std::vector<Blade> faces;
  for (std::size_t i = 1; i < bucket.profile.size(); ++i) {
    const Vec2 a = bucket.profile[i - 1], along = bucket.profile[i] - a;
    // Pitch turns z from straight up towards +x.
    const Pose frame{{a.x(), 0, a.y()}, from_rpy(0, std::atan2(along.x(), along.y()), 0)};
    faces.push_back({frame, -bucket.width_m / 2, bucket.width_m / 2, along.norm()});
  }
  return faces;
}

Volume spatial_volume(const Sweep& sweep, const Terrain& terrain, const Vec3& direction) {
  const Scan scan(sweep, terrain, direction);
  Eigen::Matrix3d axes;
  axes.col(0) = direction.normalized();
  axes.col(1) = axes.col(0).unitOrthogonal();
  axes.col(2) = axes.col(0).cross(axes.col(1));
  const Eigen::AlignedBox3d box = scan.bounds(axes);
  const Vec3 size = box.sizes();
  constexpr int kShifts = 4;
  double sum = 0, squares = 0;
  for (int k = 0; k < kShifts; ++k) {
    const double su = (k + 0.5) / kShifts, sv = ((k * 2 + 1) % kShifts + 0.25) / kShifts;
    const double v = size.y() * size.z() * mean(kLines, [&](int i) {
                       // A Fibonacci lattice; at the borders of the box lengths are 0, so they are
                       // periodic.
                       const double u = (i + su) / kLines;
                       const double w =
                           std::fmod(static_cast<double>(i) * kLinesBefore / kLines + sv, 1.0);
                       return scan.length(axes * (box.min() + Vec3(0, u * size.y(), w * size.z())));
                     });
    sum += v;
    squares += v * v;
  }
  const double v = sum / kShifts;
  const double variance = std::max(0.0, squares / kShifts - v * v) / (kShifts - 1);
  return {v, 3 * std::sqrt(variance) + 1e-6 * v};
}

Volume planar_volume(const Sweep& sweep, const Terrain& terrain, const Vec3& direction, int lines,
                     int slices) {
  const Scan scan(sweep, terrain, direction);
  const Blade& blade = sweep.blades.front();
  const double width = blade.y_high - blade.y_low;
  Eigen::Matrix3d axes;
  axes.col(0) = direction.normalized();
  axes.col(1) = Vec3::UnitY();
  axes.col(2) = axes.col(0).cross(axes.col(1));
  const Eigen::AlignedBox3d box = scan.bounds(axes);
  const double middle = sweep.world_from_bucket(0).position.y() + (blade.y_low + blade.y_high) / 2;
  const auto with = [&](int n, int m) {
    return width * box.sizes().z() * mean(n * m, [&](int i) {
             const double y = middle + width * ((i / n + 0.5) / m - 0.5);
             const double w = box.min().z() + box.sizes().z() * (i % n + 0.5) / n;
             return scan.length(y * axes.col(1) + w * axes.col(2));
           });
  };
  const double fine = with(lines, slices);
  const double coarse = with(lines * 5 / 8, (slices * 5 + 7) / 8);
  return {fine, 2 * std::abs(fine - coarse) + 1e-6 * fine};
}

bool passes_through(const Sweep& sweep, const Vec3& p) {
  const std::vector<double> times = times_of(sweep);
  for (const Blade& blade : sweep.blades) {
    const auto local = [&](double t) {
      return (sweep.world_from_bucket(t) * blade.bucket_from_blade).inverse() * p;
    };
    double before = local(times.front()).x();
    for (std::size_t i = 1; i < times.size(); ++i) {
      const double here = local(times[i]).x();
      if ((before < 0) != (here < 0)) {
        double a = times[i - 1], b = times[i];
        for (int k = 0; k < kBisections; ++k) {
          const double mid = (a + b) / 2;
          ((local(mid).x() < 0) == (before < 0) ? a : b) = mid;
        }
        const Vec3 q = local(a);
        if (q.y() >= blade.y_low && q.y() <= blade.y_high && q.z() >= 0 && q.z() <= blade.z_high) {
          return true;
        }
      }
      before = here;
    }
  }
  return false;
}

Volume sampled_volume(const Sweep& sweep, const Terrain& terrain, int sides, unsigned seed) {
  const Eigen::AlignedBox3d box =
      Scan(sweep, terrain, Vec3::UnitX()).bounds(Eigen::Matrix3d::Identity());
  constexpr int kRepeats = 4;
  const int boxes = sides * sides * sides;
  double sum = 0, squares = 0;
  for (int k = 0; k < kRepeats; ++k) {
    const double v =
        box.volume() * mean(boxes, [&](int i) {
          std::mt19937_64 random(seed +
                                 static_cast<std::uint64_t>(k) * static_cast<std::uint64_t>(boxes) +
                                 static_cast<std::uint64_t>(i));
          std::uniform_real_distribution<double> unit;
          const Vec3 f((i % sides + unit(random)) / sides,
                       (i / sides % sides + unit(random)) / sides,
                       (i / sides / sides + unit(random)) / sides);
          const Vec3 p = box.min() + f.cwiseProduct(box.sizes());
          return p.z() < terrain.height(p.head<2>()) && passes_through(sweep, p) ? 1.0 : 0.0;
        });
    sum += v;
    squares += v * v;
  }
  const double v = sum / kRepeats;
  // Four repeats tell the spread poorly: at least that of boxes that lie half inside.
  const double variance = std::max(0.0, squares / kRepeats - v * v) / (kRepeats - 1);
  const double theory = box.volume() * 0.5 / std::pow(sides, 2.0) / std::sqrt(kRepeats);
  return {v, 3 * std::max(std::sqrt(variance), theory)};
}

}  // namespace soilvdb::test
