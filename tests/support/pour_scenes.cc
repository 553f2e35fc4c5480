// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tests/support/pour_scenes.h"

#include <random>

namespace soilvdb::test {
namespace {

constexpr Goal kOpenGround{0.25, 0.5};

/// The surface over `ground` whose height falls with `distance`(x, y, level) from the level that
/// holds the volume, on a grid three times as fine.
Surface least_surface(const Columns& like, const Surface& ground, double volume_m3, double low,
                      double high, const std::function<double(double, double, double)>& distance) {
  const double fine_m = like.side_m / 3;
  struct Point {
    double x, y, ground;
  };
  std::vector<Point> points;
  for (double x = fine_m / 2; x < like.nx * like.side_m; x += fine_m)
    for (double y = fine_m / 2; y < like.ny * like.side_m; y += fine_m)
      points.push_back({x, y, ground(x, y)});
  const double level = solve(low, high, volume_m3, [&](double at) {
    double sum = 0;
    for (const Point& p : points)
      sum += std::max(0.0, at - kPourSlope * distance(p.x, p.y, at) - p.ground);
    return sum * fine_m * fine_m;
  });
  return [=](double x, double y) {
    return std::max(ground(x, y), level - kPourSlope * distance(x, y, level));
  };
}

double straight(const Vec2& from, double x, double y) { return (Vec2(x, y) - from).norm(); }

}  // namespace

double solve(double low, double high, double value, const std::function<double(double)>& holds) {
  for (int n = 0; n < 50; ++n) {
    const double middle = (low + high) / 2;
    (holds(middle) < value ? low : high) = middle;
  }
  return high;
}

Scene flat_scene(double radius, double side_m, const Vec2& shift) {
  const double length = 2 * (radius + 4) * side_m, r = radius * side_m;
  const Vec2 at = Vec2(length / 2, length / 2) + shift * side_m;
  const Surface ground = [](double, double) { return 0.0; };
  return {fmt::format("flat, {} columns of {} m", radius, side_m),
          ground,
          columns_of(length, length, side_m, ground),
          at,
          std::numbers::pi * kPourSlope * r * r * r / 3,
          [=](double x, double y) { return std::max(0.0, kPourSlope * (r - straight(at, x, y))); },
          kOpenGround};
}

Scene incline_scene(double share) {
  const double s = share * kPourSlope, a = share > 0.5 ? 0.3 : 0.6;
  const Vec2 at(1.52, 3.03);
  const Surface ground = [=](double x, double) { return (at.x() - x) * s; };
  return {fmt::format("incline {} of repose", share),
          ground,
          columns_of(5, 6, kSide_m, ground),
          at,
          std::numbers::pi * a * a * a * kPourSlope /
              (3 * std::pow(kPourSlope * kPourSlope - s * s, 1.5)),
          [=](double x, double y) {
            return std::max(ground(x, y), a - kPourSlope * straight(at, x, y));
          }};
}

Scene wall_scene(double d) {
  const Vec2 at(2.0 - d, 2.012);
  constexpr double kFace = 2, kHigh = 2;
  const Surface ground = [=](double x, double) {
    return x > kFace && x < kFace + kSide_m ? kHigh : 0.0;
  };
  Scene scene{fmt::format("wall at {} m", d), ground, columns_of(4, 4, kSide_m, ground), at, 1};
  scene.steps = true;
  scene.ground.rigid.assign(80 * 80, 0);
  for (int i = 40 * 80; i < 41 * 80; ++i) scene.ground.rigid[static_cast<std::size_t>(i)] = 1;
  const double r = solve(d, 3, 1, [=](double radius) {
    const double r3 = radius * radius * radius;
    return std::numbers::pi * kPourSlope * r3 / 3 -
           kPourSlope / 3 *
               (r3 * std::acos(d / radius) - 2 * radius * d * std::sqrt(radius * radius - d * d) +
                d * d * d * std::acosh(radius / d));
  });
  scene.truth = [=](double x, double y) {
    return x > kFace ? ground(x, y) : std::max(0.0, kPourSlope * (r - straight(at, x, y)));
  };
  return scene;
}

Scene beside_scene(bool ridge, double volume_m3) {
  const Vec2 at(1.74, 2.51);
  const Surface ground = [=](double x, double y) {
    return std::max(0.0, 0.7 - kPourSlope * straight({2.5, ridge ? y : 2.3}, x, y));
  };
  Scene scene{fmt::format("{} m3 beside a {}", volume_m3, ridge ? "ridge" : "heap"), ground,
              columns_of(5, 5, kSide_m, ground), at, volume_m3};
  scene.truth = least_surface(scene.ground, ground, volume_m3, 0, 3,
                              [=](double x, double y, double) { return straight(at, x, y); });
  return scene;
}

Scene drop_scene(double width, double volume_m3, double along_m) {
  constexpr double kEdge = 2, kDepth = 1, kBefore = 0.5;
  const Vec2 at(kEdge - kBefore, 3 + along_m), lip(kEdge, at.y());
  const auto lower = [=](double x) { return x > kEdge && x < kEdge + width; };
  const Surface ground = [=](double x, double) { return lower(x) ? -kDepth : 0.0; };
  Scene scene{fmt::format("{} m3 before a drop {} m wide", volume_m3, width), ground,
              columns_of(6, 6, kSide_m, ground), at, volume_m3};
  scene.steps = true;
  const double top = std::numbers::pi * kPourSlope * kBefore * kBefore * kBefore / 3;
  const double foot = std::numbers::pi * kDepth * kDepth * kDepth / (6 * kPourSlope * kPourSlope);
  const auto over = [=](double x, double y, double level) {
    if (!lower(x)) return straight(at, x, y);
    // Through the part of the edge that the soil stands above.
    const double reach = level / kPourSlope;
    const double half = std::sqrt(std::max(0.0, reach * reach - kBefore * kBefore));
    const double crosses = at.y() + (y - at.y()) * kBefore / (x - at.x());
    const Vec2 through(kEdge, std::clamp(crosses, at.y() - half, at.y() + half));
    return (through - at).norm() + straight(through, x, y);
  };
  if (volume_m3 > top + foot) {
    scene.truth = least_surface(scene.ground, ground, volume_m3, kBefore * kPourSlope, 3, over);
    return scene;
  }
  const double level =
      kPourSlope * std::min(kBefore, std::cbrt(3 * volume_m3 / (std::numbers::pi * kPourSlope)));
  const double below =
      std::cbrt(std::max(0.0, volume_m3 - top) * 6 * kPourSlope * kPourSlope / std::numbers::pi) -
      kDepth;
  scene.truth = [=](double x, double y) {
    return std::max(ground(x, y), lower(x) ? below - kPourSlope * straight(lip, x, y)
                                           : level - kPourSlope * straight(at, x, y));
  };
  return scene;
}

Scene gentle_scene(std::uint64_t seed, double volume_m3) {
  constexpr int kWaves = 12;
  constexpr double kSteepest = 0.9, kLength = 5, kStep = 0.02;
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  struct Wave {
    Vec2 k;
    double phase, height;
  };
  std::vector<Wave> waves;
  for (int i = 0; i < kWaves; ++i) {
    const double k = 2 * std::numbers::pi / uniform(0.5, 4), way = uniform(0, 2 * std::numbers::pi);
    waves.push_back(
        {k * Vec2(std::cos(way), std::sin(way)), uniform(0, 2 * std::numbers::pi), 1 / k});
  }
  double steepest = 0;
  for (double x = 0; x < kLength; x += kStep) {
    for (double y = 0; y < kLength; y += kStep) {
      Vec2 slope(0, 0);
      for (const Wave& w : waves) slope -= w.height * std::sin(w.k.dot(Vec2(x, y)) + w.phase) * w.k;
      steepest = std::max(steepest, slope.norm());
    }
  }
  for (Wave& w : waves) w.height *= kSteepest * kPourSlope / steepest;
  const Vec2 at(kLength / 2 + uniform(-0.1, 0.1), kLength / 2 + uniform(-0.1, 0.1));
  const Surface ground = [=](double x, double y) {
    double h = 0;
    for (const Wave& w : waves) h += w.height * std::cos(w.k.dot(Vec2(x, y)) + w.phase);
    return h;
  };
  Scene scene{fmt::format("gentle ground {}", seed), ground,
              columns_of(kLength, kLength, kSide_m, ground), at, volume_m3};
  scene.truth = least_surface(scene.ground, ground, volume_m3, -3, 3,
                              [=](double x, double y, double) { return straight(at, x, y); });
  return scene;
}

Columns truth_of(const Scene& scene) {
  Columns truth = scene.ground;
  for (int i = 0; i < truth.nx * truth.ny; ++i)
    truth.at(i) = scene.truth(middle_m(truth, i).x(), middle_m(truth, i).y());
  return truth;
}

std::vector<Scene> scenes() {
  std::vector<Scene> all;
  for (const Vec2& shift : {Vec2(0, 0), Vec2(0.5, 0.5), Vec2(0.31, 0.17)}) {
    for (const double radius : {12.0, 24.0}) all.push_back(flat_scene(radius, 0.05, shift));
    all.push_back(flat_scene(40, 0.025, shift));
  }
  for (const double share : {0.3, 0.8}) all.push_back(incline_scene(share));
  for (const double d : {0.1, 0.5}) all.push_back(wall_scene(d));
  for (const double v : {0.3, 1.5}) {
    all.push_back(beside_scene(false, v));
    all.push_back(beside_scene(true, v));
  }
  for (const double v : {0.05, 0.2, 1.0, 1.5, 3.0}) {
    all.push_back(drop_scene(1.5, v));
    all.push_back(drop_scene(100, v));
  }
  for (std::uint64_t seed = 0; seed < 3; ++seed) all.push_back(gentle_scene(seed, 0.7));
  all.push_back(drop_scene(1.5, 1, 0.025));
  all.push_back(drop_scene(1.5, 3, 0));
  return all;
}

}  // namespace soilvdb::test
