// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What collapse keeps to on any ground, and random ground against an independent solver.
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <bit>
#include <chrono>
#include <iostream>
#include <string>

#include "core/constants.h"
#include "core/lattice/splitmix64.h"
#include "tests/support/collapse_scenes.h"
#include "tests/support/convex_heights.h"

namespace soilvdb::test {
namespace collapse_laws_test {

const Repose kRepose{.slope = std::tan(35 * kDegree), .swell = 1.25};
/// Depth of soil that surely isn't what a brink holds back: what a slope drops across a column.
const double kDeep = kRepose.slope + double{kFilmDepth};

double most_moved(const std::vector<double>& a, const std::vector<double>& b) {
  double most = 0;
  for (std::size_t c = 0; c < a.size(); ++c) most = std::max(most, std::abs(a[c] - b[c]) / kSide);
  return most;
}

/// Rough ground of several kinds: gentle and steep support, holes in it, odd sides.
std::vector<SoilColumns> grounds() {
  std::vector<SoilColumns> all;
  for (unsigned seed = 0; seed < 4; ++seed) {
    const int nx = 64 + static_cast<int>(seed % 2) * 17, ny = 48 + static_cast<int>(seed / 2) * 9;
    all.push_back(rough(10 * seed, nx, ny, 0.3 * seed, 0.8));
  }
  std::mt19937 random(7);
  all[1].missing.resize(all[1].top_m.size());
  for (std::uint8_t& m : all[1].missing) m = random() % 10 == 0;
  return all;
}

TEST(CollapseLaws, RandomGroundIsThatOfAnIndependentConvexSolver) {
  // What rest leaves: a slope's error over the way soil came, at most across the grid.
  constexpr int kSides = 24;
  constexpr double kMost = 2 * kFluxTolerance * kSides / 4, kRms = kMost / 4;
  for (unsigned seed = 0; seed < 3; ++seed) {
    const SoilColumns ground = rough(100 + seed, kSides, kSides, 0.2, 0.9 + 0.3 * seed);
    const Repose repose{.slope = std::tan((25 + 5 * seed) * kDegree), .swell = 1 + 0.2 * seed};
    const std::vector<double> exact = ConvexHeights(ground, repose).solve(2001, 1e-3);
    const Collapse collapse = test::collapse(ground, repose);
    std::vector<double> off;
    double moved = 0;
    for (std::size_t c = 0; c < exact.size(); ++c) {
      off.push_back(collapse.top_m[c] / kSide - exact[c]);
      moved = std::max(moved, std::abs(exact[c] - ground.top_m[c] / kSide));
    }
    const Error e = error_of(off);
    RecordProperty("solver" + std::to_string(seed) + "_rms", std::to_string(e.rms));
    RecordProperty("solver" + std::to_string(seed) + "_max", std::to_string(e.max));
    RecordProperty("solver" + std::to_string(seed) + "_moved", std::to_string(moved));
    EXPECT_GT(moved, 1);
    EXPECT_LE(e.rms, kRms) << seed;
    EXPECT_LE(e.max, kMost) << seed;
  }
}

TEST(CollapseLaws, MassIsConservedWithSwellAndNothingGoesBelowTheBase) {
  for (const SoilColumns& ground : grounds()) {
    const Collapse collapse = test::collapse(ground, kRepose);
    ASSERT_GT(collapse.iterations, 0);
    double bank = 0, loose = 0, fill = 0;
    for (std::size_t c = 0; c < ground.top_m.size(); ++c) {
      const double was = ground.top_m[c], is = collapse.top_m[c];
      if (!ground.missing.empty() && ground.missing[c]) {
        EXPECT_EQ(was, is);
        continue;
      }
      EXPECT_GE(is, ground.base_m[c] - 1e-12);
      const double left = collapse.bank_m[c], rise = (is - left) - (was - ground.bank_m[c]);
      EXPECT_LE(left, std::min(is, ground.bank_m[c]));
      EXPECT_GE(left, std::min(ground.base_m[c], is));
      bank += ground.bank_m[c] - left;
      (rise > 0 ? fill : loose) += std::abs(rise);
    }
    EXPECT_NEAR(kRepose.swell * bank + loose, fill, 1e-9 * fill);
  }
}

TEST(CollapseLaws, WhatCollapsedIsAtRest) {
  constexpr double kMoves = 0.02, kP99_deg = 1.5, kWorst_deg = 3;
  int n = 0;
  for (const SoilColumns& ground : grounds()) {
    const Collapse collapse = test::collapse(ground, kRepose);
    const SoilColumns rest = after(ground, collapse);
    EXPECT_LE(most_moved(test::collapse(rest, kRepose).top_m, rest.top_m), kMoves);
    const std::vector<double> steep = steepness(rest, kRepose.slope, kDeep);
    RecordProperty("rest" + std::to_string(n) + "_p99deg",
                   std::to_string(steep[steep.size() * 99 / 100]));
    RecordProperty("rest" + std::to_string(n) + "_maxdeg", std::to_string(steep.back()));
    RecordProperty("rest" + std::to_string(n++) + "_steps", collapse.iterations);
    EXPECT_LE(steep[steep.size() * 99 / 100], kP99_deg);
    EXPECT_LE(steep.back(), kWorst_deg);
  }
}

TEST(CollapseLaws, NothingMovesWhereNothingIsTooSteep) {
  SoilColumns ground = sampled(40, 30, [](double x, double y) {
    const double z = 0.45 * x + 0.5 * y + 0.03 * std::sin(x);
    return Layers{-100, z - 1, z};
  });
  const Collapse gentle = collapse(ground, kRepose);
  EXPECT_EQ(gentle.top_m, ground.top_m);
  EXPECT_EQ(gentle.iterations, 0);
  // Whatever stands by itself isn't soil, however steep.
  ground = rough(3, 40, 30, 2, 2);
  ground.base_m = ground.bank_m = ground.top_m;
  EXPECT_EQ(collapse(ground, kRepose).top_m, ground.top_m);
  // Nor does soil fall off the grid, or into what isn't there.
  ground = sampled(12, 12, [](double, double) { return Layers{0, 9, 20}; });
  ground.missing.assign(ground.top_m.size(), 0);
  ground.missing[40] = 1;
  ground.top_m[40] = ground.bank_m[40] = ground.base_m[40] = -1e9;
  EXPECT_EQ(collapse(ground, kRepose).top_m, ground.top_m);
}

/// The same ground mirrored and turned: bit 0 mirrors x, bit 1 mirrors y, bit 2 swaps them.
template <class T>
std::vector<T> turned(const std::vector<T>& of, int nx, int ny, int how) {
  std::vector<T> to(of.size());
  for (std::size_t c = 0; c < of.size(); ++c) {
    const int x = static_cast<int>(c) % nx, y = static_cast<int>(c) / nx;
    const int u = how & 1 ? nx - 1 - x : x, v = how & 2 ? ny - 1 - y : y;
    to[static_cast<std::size_t>(how & 4 ? u * ny + v : v * nx + u)] = of[c];
  }
  return to;
}

TEST(CollapseLaws, MirroredOrTurnedGroundCollapsesMirroredOrTurned) {
  int n = 0;
  for (const SoilColumns& ground : grounds()) {
    const Collapse straight = collapse(ground, kRepose);
    // Columns are joined to coarser ones from the low corner, so odd sides start elsewhere.
    const bool even = ground.nx % 8 == 0 && ground.ny % 8 == 0;
    double worst = 0;
    for (int how = 1; how < 8; ++how) {
      const int nx = ground.nx, ny = ground.ny;
      SoilColumns other = ground;
      if (how & 4) std::swap(other.nx, other.ny);
      other.base_m = turned(ground.base_m, nx, ny, how);
      other.bank_m = turned(ground.bank_m, nx, ny, how);
      other.top_m = turned(ground.top_m, nx, ny, how);
      if (!ground.missing.empty()) other.missing = turned(ground.missing, nx, ny, how);
      const std::vector<double> ought = turned(straight.top_m, nx, ny, how);
      worst = std::max(worst, most_moved(collapse(other, kRepose).top_m, ought));
    }
    RecordProperty("turned" + std::to_string(n++) + "_sides", std::to_string(worst));
    EXPECT_LE(worst, even ? 0 : 2 * kFluxTolerance * 4);
  }
}

TEST(CollapseLaws, BitsAreTheSameForAnyNumberOfThreads) {
  const SoilColumns ground = rough(5, 128, 120, 0.6, 0.8);
  std::vector<double> one;
  for (const int threads : {1, 2, 4}) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                      static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    const Collapse c = arena.execute([&] { return collapse(ground, kRepose); });
    if (threads == 1) one = c.top_m;
    EXPECT_EQ(c.top_m, one) << threads << " threads";
  }
}

/// A cone with noise on steps, made by arithmetic alone, so that no library is in the input.
SoilColumns rubble() {
  SoilColumns ground{96, 88, kSide, {}, {}, {}, {}};
  for (int y = 0; y < ground.ny; ++y) {
    for (int x = 0; x < ground.nx; ++x) {
      const double noise = static_cast<double>(splitmix64(ground.top_m.size()) >> 40) / (1 << 24);
      const double base = x < 60 ? 0 : -0.5;
      ground.base_m.push_back(base);
      ground.bank_m.push_back(base + 0.1 * noise);
      ground.top_m.push_back(base + 0.2 * noise +
                             (x > 20 && x < 50 && y > 30 && y < 60 ? 0.9 : 0.2));
    }
  }
  return ground;
}

TEST(CollapseLaws, BitsAreTheSameOnAnyBuild) {
  const Collapse c = collapse(rubble(), {.slope = 0.7, .swell = 1.25});
  std::uint64_t hash = 0;
  const auto add = [&](double v) {
    hash = (hash ^ std::bit_cast<std::uint64_t>(v)) * 0x100000001b3;
  };
  for (const double z : c.top_m) add(z);
  EXPECT_EQ(hash, 6483720841327867427u);
}

TEST(CollapseLaws, AWallTakesMilliseconds) {
  const SoilColumns wall = sampled<1>(96, 96, [](double x, double) {
    return Layers{0, x < 0 ? 20. : 0, x < 0 ? 20. : 0};
  });
  tbb::task_arena arena(2);
  double least_ms = 1e9;
  for (int i = 0; i < 9; ++i) {
    const auto start = std::chrono::steady_clock::now();
    arena.execute([&] { return collapse(wall, kRepose); });
    const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
    least_ms = std::min(least_ms, took.count());
  }
  RecordProperty("wall_ms", std::to_string(least_ms));
  std::cout << "wall of 96 x 96 columns: " << least_ms << " ms\n";
}

TEST(CollapseLaws, HeightsMayBeInAnyFrame) {
  const SoilColumns ground = rough(6, 64, 48, 0.3, 0.8);
  SoilColumns high = ground;
  for (auto* heights : {&high.base_m, &high.bank_m, &high.top_m}) {
    for (double& z : *heights) z += 4096;  // exact but for the last bits
  }
  std::vector<double> back = collapse(high, kRepose).top_m;
  for (double& z : back) z -= 4096;
  EXPECT_LE(most_moved(back, collapse(ground, kRepose).top_m), 1e-3);
}

}  // namespace collapse_laws_test
}  // namespace soilvdb::test
