// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Piles of poured soil against the truth: closed forms, or distances in closed form with the level
// that holds the volume found on a finer grid. With the environment variable SOILVDB_TABLE set,
// prints every error and time.
#include <gtest/gtest.h>

#include <chrono>
#include <limits>
#include <random>

#include "tests/support/pour_scenes.h"

namespace soilvdb::test {
namespace pour_test {

constexpr double kPi = std::numbers::pi;
constexpr int kParts = 50;

constexpr double kPartsRms = 0.02;
constexpr double kLevels = 1e-4;  ///< of levels found one by one
/// What columns make of a truth's volume that wasn't found by them.
constexpr double kTruthsVolume = 1e-3;
constexpr double kSlope_deg = 0.3, kCoarseSlope_deg = 0.6;  ///< from 12 columns of radius on, fewer

double ms_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

TEST(Pour, LiesAsTheTruthDoes) {
  Pourer pourer;
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    const Columns truth = truth_of(scene);
    Columns ground = scene.ground;
    const auto start = std::chrono::steady_clock::now();
    const Deposit deposit = pourer.pour(ground, scene.source, scene.volume_m3, kPourSlope);
    const double ms = ms_since(start);
    const Difference off = difference(scene.ground, ground, truth);
    print("{:40} {:5} columns {:5.2f} ms: rms {:.3f} p99 {:.3f} max {:.3f}\n", scene.name,
          off.columns, ms, off.rms, off.p99, off.max);
    EXPECT_NEAR(volume_between(scene.ground, truth), scene.volume_m3,
                kTruthsVolume * scene.volume_m3);
    EXPECT_EQ(deposit.left_m3, 0);
    EXPECT_GT(off.columns, 100u);
    EXPECT_LE(off.rms, scene.goal.rms);
    EXPECT_LE(off.p99, scene.goal.p99);
  }
}

/// Distance in plan from a line's points.
double distance_m(const Vec2& at, const Vec2& from, const Vec2& along) {
  return (at - from - std::clamp(along.dot(at - from) / along.squaredNorm(), 0.0, 1.0) * along)
      .norm();
}

TEST(Pour, AlongALineIsARidgeWithALevelTop) {
  Pourer pourer;
  for (const double turn : {0.0, 0.3, kPi / 4, 2.0}) {
    SCOPED_TRACE(turn);
    const double height_m = 0.5, length_m = 1.6;
    const Columns before = columns_of(5, 5, kSide_m, [](double, double) { return 0.0; });
    const Vec2 along = length_m * Vec2(std::cos(turn), std::sin(turn));
    const Vec2 from = Vec2(2.513, 2.481) - along / 2;
    const double volume_m3 = height_m * height_m * length_m / kPourSlope +
                             kPi * std::pow(height_m, 3) / (3 * kPourSlope * kPourSlope);
    Columns ground = before, truth = before;
    ASSERT_EQ(Pourer::look_at_line(ground, from, along, kPourSlope), Pourer::Line::kRests);
    const Deposit deposit = pourer.pour(ground, from, volume_m3, kPourSlope, false, along);
    for (int i = 0; i < truth.nx * truth.ny; ++i)
      truth.at(i) =
          std::max(0.0, height_m - kPourSlope * distance_m(middle_m(truth, i), from, along));
    const Difference off = difference(before, ground, truth);
    EXPECT_EQ(deposit.left_m3, 0);
    EXPECT_NEAR(volume_between(before, ground), volume_m3, 1e-9);
    EXPECT_LE(off.rms, 0.05);
    EXPECT_LE(off.max, 0.15);
  }
}

TEST(Pour, RestsAlongALineOnlyWhereItIsNotTooSteepOnTheMeanAndNoneIsNoGround) {
  using Line = Pourer::Line;
  const auto line = [](const Columns& ground) {
    return Pourer::look_at_line(ground, {1, 2.5}, {3, 0}, kPourSlope);
  };
  const auto slope = [](double share) {
    return columns_of(5, 5, kSide_m, [=](double x, double) { return share * kPourSlope * x; });
  };
  EXPECT_EQ(line(slope(0.9)), Line::kRests);
  EXPECT_EQ(line(slope(1.5)), Line::kTooSteep);
  const auto step = [](double x, double) { return x > 3 ? 1 : 0; };
  EXPECT_EQ(line(columns_of(5, 5, kSide_m, step)), Line::kTooSteep);
  Columns walled = slope(0);
  walled.rigid.assign(walled.height_m.size(), 0);
  walled.rigid[static_cast<std::size_t>(walled.index(40, 50))] = 1;
  EXPECT_EQ(line(walled), Line::kBlocked);
  // Columns of a heap are too steep here and there, by what counts err.
  for (const std::uint64_t seed : {1, 2, 3, 4, 5, 6, 7, 8, 9}) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> error(-0.15 * kSide_m, 0.15 * kSide_m);
    const auto heap = [&](double share) {
      return columns_of(5, 5, kSide_m,
                        [&](double x, double) { return share * kPourSlope * x + error(random); });
    };
    EXPECT_EQ(line(heap(1)), Line::kRests);
    EXPECT_EQ(line(heap(1.5)), Line::kTooSteep);
  }
}

/// Slope of the line fitted to the heights on a ray, in its worst of 48 directions.
double worst_slope_deg(const Columns& c, const Vec2& from, double radius_m) {
  double worst = 0;
  for (int n = 0; n < 48; ++n) {
    const Vec2 way(std::cos(n * kPi / 24), std::sin(n * kPi / 24));
    double count = 0, r1 = 0, r2 = 0, h1 = 0, rh = 0;
    for (double r = 2 * c.side_m; r < radius_m - c.side_m; r += c.side_m / 4) {
      const Vec2 at = (from + r * way) / c.side_m - Vec2(0.5, 0.5);
      const int x = static_cast<int>(at.x()), y = static_cast<int>(at.y());
      const double u = at.x() - x, v = at.y() - y;
      const double h = (1 - u) * ((1 - v) * c.at(c.index(x, y)) + v * c.at(c.index(x, y + 1))) +
                       u * ((1 - v) * c.at(c.index(x + 1, y)) + v * c.at(c.index(x + 1, y + 1)));
      ++count, r1 += r, r2 += r * r, h1 += h, rh += r * h;
    }
    const double slope = (r1 * h1 - count * rh) / (count * r2 - r1 * r1);
    worst = std::max(worst, std::abs(std::atan(slope) - std::atan(kPourSlope)) * 180 / kPi);
  }
  return worst;
}

TEST(Pour, AConeIsRound) {
  Pourer pourer;
  for (const double radius : {8.0, 12.0, 24.0, 40.0})
    for (const Vec2& shift : {Vec2(0, 0), Vec2(0.5, 0.5), Vec2(0.31, 0.17)}) {
      Scene scene = flat_scene(radius, kSide_m, shift);
      pourer.pour(scene.ground, scene.source, scene.volume_m3, kPourSlope);
      const double off = worst_slope_deg(scene.ground, scene.source, radius * kSide_m);
      print("radius {:2} columns: slope off by {:.3f} degrees\n", radius, off);
      EXPECT_LE(off, radius < 12 ? kCoarseSlope_deg : kSlope_deg) << radius;
    }
}

TEST(Pour, MoreSoilNeverLiesLower) {
  Pourer pourer;
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    Columns last = scene.ground;
    for (int n = 1; n <= 12; ++n) {
      Columns more = scene.ground;
      pourer.pour(more, scene.source, scene.volume_m3 * n / 12, kPourSlope);
      for (int i = 0; i < more.nx * more.ny; ++i)
        ASSERT_GE(more.at(i), last.at(i) - kLevels * kSide_m) << n;
      last = more;
    }
  }
}

TEST(Pour, InFiftyPartsLiesAsAtOnce) {
  Pourer pourer;
  for (const Scene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    Columns once = scene.ground, parts = scene.ground;
    pourer.pour(once, scene.source, scene.volume_m3, kPourSlope);
    const auto start = std::chrono::steady_clock::now();
    for (int n = 0; n < kParts; ++n)
      pourer.pour(parts, scene.source, scene.volume_m3 / kParts, kPourSlope);
    const Difference off = difference(scene.ground, once, parts);
    print("{:40} {:7.2f} ms a part: rms {:.4f} p99 {:.4f} max {:.4f}\n", scene.name,
          ms_since(start) / kParts, off.rms, off.p99, off.max);
    EXPECT_LE(off.rms, kPartsRms);
  }
}

TEST(Pour, TakesSoLong) {
  Pourer pourer;
  const double volumes_m3[] = {1, 0.02}, sides_m[] = {0.05, 0.025};
  for (int i = 0; i < 2; ++i) {
    double best = std::numeric_limits<double>::infinity();
    for (int n = 0; n < 20; ++n) {
      Columns ground(100, 100, sides_m[i]);
      const auto start = std::chrono::steady_clock::now();
      pourer.pour(ground, Vec2(50.3, 50.6) * sides_m[i], volumes_m3[i], kPourSlope);
      best = std::min(best, ms_since(start));
    }
    print("{} m3 on columns of {} m: {:.3f} ms\n", volumes_m3[i], sides_m[i], best);
  }
}

}  // namespace pour_test
}  // namespace soilvdb::test
