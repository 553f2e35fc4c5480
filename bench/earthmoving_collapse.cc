// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that stands too steep against where it must come to rest: closed forms, and on random ground
// a convex solver that shares no code with the engine.
#include <fmt/core.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <limits>

#include "bench/earthmoving.h"
#include "bench/peers/neighbour_rules.h"
#include "core/settle/settler.h"
#include "tests/support/collapse_scenes.h"
#include "tests/support/collapse_truths.h"
#include "tests/support/convex_heights.h"

namespace soilvdb::bench {
namespace {

using test::Collapse, test::collapse, test::Layers, test::Repose, test::SoilColumns;

constexpr double kSideVoxel = 0.05;
constexpr int kSides = 96;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kRms = 0.5, kP99 = 1.5;

/// Ground that fails, about its middle, in sides: which points are soil below `height`, and where
/// they must come to rest.
struct Failure {
  std::string name;
  Shape height, truth;
};

std::vector<Failure> failures(double swell) {
  constexpr double kWall = 20, kPit = 24, kPitDepth = 16, kTower = 8, kTowerHeight = 32;
  const double wall = test::wall_beta(kWall, swell);
  const double pit = test::pit_beta(kPit, kPitDepth, kSlope, swell);
  const double tower = test::tower_apex(kTower, kTowerHeight, kSlope, swell);
  return {
      {"wall", [=](double x, double) { return x < 0 ? kWall : 0; },
       [=](double x, double) { return std::clamp(wall - kSlope * x, 0.0, kWall); }},
      {"round pit", [=](double x, double y) { return std::hypot(x, y) < kPit ? 0 : kPitDepth; },
       [=](double x, double y) {
         return std::clamp(pit + kSlope * (std::hypot(x, y) - kPit), 0.0, kPitDepth);
       }},
      {"tower", [=](double x, double y) { return std::hypot(x, y) < kTower ? kTowerHeight : 0; },
       [=](double x, double y) { return std::max(0.0, tower - kSlope * std::hypot(x, y)); }}};
}

/// Bank soil that swells as it fails, as columns.
void columns(Goals& goals) {
  constexpr double kSwell = 1.25;
  for (const Failure& f : failures(kSwell)) {
    const SoilColumns ground = test::sampled(kSides, kSides, [&](double x, double y) {
      return Layers{0, f.height(x, y), f.height(x, y)};
    });
    const test::Error e =
        test::off(ground, collapse(ground, {.slope = kSlope, .swell = kSwell}), f.truth);
    add(goals, "collapsed " + f.name + " of bank soil, swell 25 %", {e.rms, e.p99}, kRms, kP99);
  }
}

/// Loose soil on a floor between rigid walls, in samples.
struct Box {
  static constexpr double kHalf_m = kSides * kSideVoxel / 2;
  Ground ground{kSideVoxel, Vec3(kSideVoxel / 2, kSideVoxel / 2, 0), make_plane(0, {0, 0})};
  Settler settler{ground, *loam().soil, {}};

  explicit Box(const Shape& height) {
    constexpr double kHigh = 2.4;
    const double wide = kHalf_m + 8 * kSideVoxel;
    const auto inside = [](double x, double y) {
      return std::max(std::abs(x), std::abs(y)) < kHalf_m;
    };
    carve(ground, {Vec3(-wide, -wide, 0), Vec3(wide, wide, kHigh)},
          [&](double x, double y) { return inside(x, y) ? 0.0 : kHigh; });
    add_loose(ground, {Vec3(-wide, -wide, 0), Vec3(wide, wide, kHigh)}, [&](double x, double y) {
      return inside(x, y) ? kSideVoxel * height(x / kSideVoxel, y / kSideVoxel) : 0;
    });
  }
  double settle_us() {
    const Stopwatch watch;
    TileSet may_slide;
    settler.settle({Vec3(-kHalf_m, -kHalf_m, 0), Vec3(kHalf_m, kHalf_m, 1)}, true, may_slide);
    return watch.us();
  }
  Heights columns() const { return heights(ground, -kSides / 2, -kSides / 2, kSides, kSides); }
};

void samples(Goals& goals) {
  for (const Failure& f : failures(1)) {
    Box box(f.height);
    const Heights before = box.columns();
    const double mass = box.ground.change_m3() / box.ground.sample_m3();
    box.settle_us();
    const Heights after = box.columns();
    std::vector<double> differences;
    for (int x = -kSides / 2; x < kSides / 2; ++x) {
      for (int y = -kSides / 2; y < kSides / 2; ++y) {
        const double ought = f.truth(x + 0.5, y + 0.5), was = before.cell(x, y);
        if (std::max(std::abs(after.cell(x, y) - was), std::abs(ought - was)) > 0.01)
          differences.push_back(after.cell(x, y) - ought);
      }
    }
    const double flying =
        static_cast<double>(box.settler.totals().pending / box.settler.units().loose);
    const double lost = mass - flying - box.ground.change_m3() / box.ground.sample_m3();
    add(goals, "collapsed " + f.name + " of loose soil, in samples", off(std::move(differences)),
        kRms, kP99);
    goals.add({"the same, samples lost", std::abs(std::round(lost)), "", 0.0});
  }
}

void time(const Options& options, Goals& goals) {
  const tbb::global_control two(tbb::global_control::max_allowed_parallelism, 2);
  const Shape wall = failures(1).front().height;
  goals.add({"collapse of a wall 1 m high, 4.8 m long, 5 cm, 2 threads",
             median_ms(options.quick ? 1 : 15, [&] { return Box(wall).settle_us(); }), "ms", 20});
}

/// A wall at 30 degrees to the grid: how far it is from rest after so much time, by the engine and
/// by rules between neighbours.
void error_over_time(const Options& options) {
  constexpr double kHigh = 20, kStrip = 10;
  const double c = std::cos(30 * kDegree), s = std::sin(30 * kDegree);
  const SoilColumns ground = test::sampled(kSides, kSides, [&](double x, double y) {
    const double z = c * x + s * y < 0 ? kHigh : 0;
    return Layers{0, z, z};
  });
  const Shape truth = [&](double x, double y) {
    return std::abs(c * y - s * x) > kStrip
               ? kNan
               : std::clamp(kHigh / 2 - kSlope * (c * x + s * y), 0.0, kHigh);
  };
  Csv csv(options.out / "wall_error.csv", "who,ms,rms_voxels");
  const auto row = [&](const std::string& who, double ms, const std::vector<double>& top_m) {
    Collapse result;
    result.top_m = top_m;
    csv.row(fmt::format("{},{:.4g},{:.4g}", who, ms, test::off(ground, result, truth).rms));
  };
  tbb::task_arena(1).execute([&] {
    const Repose repose{.slope = kSlope, .swell = 1};
    const double ms = median_ms(5, [&] {
      const Stopwatch watch;
      collapse(ground, repose);
      return watch.us();
    });
    row("soilvdb", ms, collapse(ground, repose).top_m);
  });
  for (const int neighbours : {4, 8}) {
    Heights start{0, 0, kSides, kSides, {}};
    for (int x = 0; x < kSides; ++x)
      for (int y = 0; y < kSides; ++y)
        start.z.push_back(ground.top_m[static_cast<std::size_t>(y * kSides + x)] / test::kSide);
    NeighbourRule rule(start, neighbours, kSlope);
    double us = 0, next = 0;
    for (bool moved = true; moved;) {
      const Stopwatch sweep;
      moved = rule.sweep();
      us += sweep.us();
      if (moved && us < next) continue;
      next = 1.2 * us;
      std::vector<double> top_m;
      for (int y = 0; y < kSides; ++y)
        for (int x = 0; x < kSides; ++x) top_m.push_back(rule.ground().cell(x, y) * test::kSide);
      row(neighbours == 4 ? "four" : "eight", us / 1e3, top_m);
    }
  }
}

/// Random ground against the solver, on the same columns and on ones half as wide.
void solver(const Options& options, Goals& goals) {
  const int sides = options.quick ? 12 : 40, grounds = options.quick ? 1 : 6;
  constexpr double kMoved = 0.01, kNear = 1e-3;
  constexpr int kRounds = 3000;
  Csv csv(options.out / "solver.csv", "ground,fine,columns,rms_voxels,p99_voxels");
  for (const int fine : {1, 2}) {
    std::vector<double> all;
    for (int n = 0; n < grounds; ++n) {
      const auto seed = static_cast<unsigned>(200 + 10 * n);
      const double slope = 0.9 + 0.1 * n;
      const SoilColumns ground = test::rough(seed, sides, sides, 0.2, slope);
      const Repose repose{.slope = kSlope, .swell = 1.25};
      const Collapse ours = collapse(ground, repose);
      const std::vector<double> exact =
          test::ConvexHeights(test::rough(seed, sides, sides, 0.2, slope, fine), repose)
              .solve(fine * kRounds, kNear);
      std::vector<double> differences;
      for (int y = 0; y < sides; ++y) {
        for (int x = 0; x < sides; ++x) {
          double ought = 0;
          for (int k = 0; k < fine * fine; ++k)
            ought += exact[static_cast<std::size_t>((fine * y + k / fine) * fine * sides +
                                                    fine * x + k % fine)];
          ought /= fine * fine * fine;
          const auto i = static_cast<std::size_t>(y * sides + x);
          const double is = ours.top_m[i] / test::kSide;
          if (std::abs(is - ground.top_m[i] / test::kSide) > kMoved)
            differences.push_back(is - ought);
        }
      }
      all.insert(all.end(), differences.begin(), differences.end());
      const auto count = differences.size();
      const Off off = bench::off(std::move(differences));
      csv.row(fmt::format("{},{},{},{:.4f},{:.4f}", n, fine, count, off.rms, off.p99));
    }
    add(goals,
        fmt::format("{} random grounds against a convex solver{}", grounds,
                    fine == 1 ? "" : ", its columns half as wide"),
        off(std::move(all)), kRms, kP99);
  }
}

}  // namespace

void measure_collapse(const Options& options, Goals& goals) {
  columns(goals);
  samples(goals);
  time(options, goals);
  error_over_time(options);
  solver(options, goals);
}

}  // namespace soilvdb::bench
