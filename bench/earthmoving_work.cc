// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Work at random: that mass closes, and that nothing is left too steep.
#include <fmt/core.h>

#include <algorithm>
#include <random>

#include "bench/earthmoving.h"
#include "tests/support/collapse_scenes.h"
#include "tests/support/earthmoving_fixture.h"

namespace soilvdb::bench {
namespace {

/// A bucket that wanders about at random, digs, tips over a hopper and beside it, under pours.
void mass(const Options& options, Goals& goals) {
  const int operations = options.quick ? 500 : 1'000'000;
  std::mt19937_64 random(1);
  const auto draw = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  std::vector<Pour> pours;
  for (int i = 0; i < operations / 50; ++i)
    pours.push_back({"", {draw(-4, 4), draw(-4, 4), 4}, 0, 0, draw(0.001, 0.1)});
  Earthmoving earthmoving = loam(std::move(pours));
  earthmoving.hoppers.push_back({"truck", {Vec2(-5, -1), Vec2(-3, 1)}, 1.2});
  Ground ground(0.1, Vec3::Zero(), make_plane(0, {0.1, 0.05}));
  Tracker tracker(ground, {digger()}, earthmoving);
  std::int64_t worst = 0;
  Vec3 at(0, 0, 1), rpy(0, 0, 0);
  for (int i = 0; i < operations; ++i) {
    if (i % 50 == 0) {
      tracker.pour(static_cast<std::size_t>(i / 50), 0);
    } else {
      for (int a = 0; a < 3; ++a) at[a] += draw(-0.2, 0.2);
      at = at.cwiseMax(Vec3(-4, -4, -0.8)).cwiseMin(Vec3(4, 4, 2));
      rpy.y() = std::clamp(rpy.y() + draw(-0.3, 0.3), -1.6, 1.6);
      rpy.z() += draw(-0.2, 0.2);
      tracker.update(0, Pose{at, from_rpy(rpy.x(), rpy.y(), rpy.z())});
    }
    worst = std::max(worst, std::abs(residual(tracker)));
  }
  goals.add({fmt::format("mass residual over {} random operations", operations),
             static_cast<double>(worst), "units", 0.0});
}

/// Four machines, three pours and a hopper at random on rough ground, then all comes to rest.
void steepness(const Options& options, Goals& goals) {
  const int steps = options.quick ? 100 : 4000;
  constexpr double kMost_deg = 3;
  constexpr double kVoxel = 0.1;
  const test::Waves waves(4, 0.35, 0.8, 6);
  test::Work work(posts(waves, {Vec2(-7, -6), Vec2(7, 6)}, 0.25), 21, kVoxel);
  for (int i = 0; i < steps; ++i) work.step();
  for (std::size_t m = 0; m < work.at.size(); ++m)  // out of the way
    work.tracker.update(m, {{0, 0, 9}, work.at[m].rotation});
  work.tracker.come_to_rest();
  std::vector<double> over = test::over_repose(test::all_of(work.ground));
  const auto steep = static_cast<double>(
      over.end() - std::upper_bound(over.begin(), over.end(), kMost_deg * kDegree));
  const std::string name =
      fmt::format("slope over repose after {} operations on rough ground", steps);
  const auto columns = over.size();
  goals.add({name + ", p99",
             quantile(over, 0.99) / kDegree,
             "deg",
             1.5,
             {},
             fmt::format("{} columns", columns)});
  goals.add({"the same, steepest",
             quantile(over, 1) / kDegree,
             "deg",
             kMost_deg,
             {},
             fmt::format("{} columns over {} degrees", steep, kMost_deg)});
  goals.add({"the same, mass residual", static_cast<double>(std::abs(test::residual(work.tracker))),
             "units", 0.0});
}

}  // namespace

void measure_work(const Options& options, Goals& goals) {
  mass(options, goals);
  steepness(options, goals);
}

}  // namespace soilvdb::bench
