// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What it takes to copy ground and the machines on it, and how much of it the copy takes.
#include <benchmark/benchmark.h>
#include <malloc.h>

#include <cmath>
#include <memory>
#include <vector>

#include "bench/site.h"
#include "soilvdb/tracker.h"

namespace soilvdb::bench {
namespace {

constexpr auto kUs = benchmark::kMicrosecond;
constexpr double kVoxel = 0.05, kSide = 4.5;

/// A pit of 20 m2, taken down in slices side by side.
void dig_pit(Tracker& tracker) {
  const auto at = [](double x, double y, double z) {
    return Pose{{x, y, hill_height(0, 0) + z}, from_rpy(0, 0.1 * x, 0)};
  };
  constexpr int kSlices = 4, kLanes = 4;
  for (int slice = 0; slice < kSlices; ++slice) {
    for (int lane = 0; lane < kLanes; ++lane) {
      const double y = kSide * ((lane + 0.5) / kLanes - 0.5), z = -0.3 * (slice + 1);
      tracker.update(0, at(-kSide / 2, y, 6));
      for (int i = 0; i <= 50; ++i) {
        const double s = i / 50.0;
        tracker.update(0, at(kSide * (s - 0.5), y, z * std::sin(3.14159 * s)));
      }
      tracker.update(0, at(kSide / 2, y, 6));
    }
  }
}

/// A copy of ground and tracker. @param moves the soil does @param drops its end counts, too
void clone(benchmark::State& state, bool moves, bool drops) {
  Ground ground(kVoxel, Vec3::Zero(), make_hills(100));
  Bucket bucket = excavator_bucket();
  Earthmoving earthmoving;
  if (moves) {
    bucket.profile = {{0, 0}, {-0.5, 0.1}, {-0.6, 0.5}, {-0.3, 0.75}, {0, bucket.height_m}};
    earthmoving.soil.emplace();
    earthmoving.soil->repose_rad = 0.61;
    earthmoving.soil->swell = 0.25;
  }
  Tracker tracker(ground, {bucket}, earthmoving);
  dig_pit(tracker);
  struct Clone {
    std::unique_ptr<Ground> ground;
    Tracker tracker;
    explicit Clone(const Ground& of, const Tracker& on)
        : ground(of.clone()), tracker(*ground, on) {}
  };
  std::vector<std::unique_ptr<Clone>> clones;
  const auto make = [&] { clones.push_back(std::make_unique<Clone>(ground, tracker)); };
  const std::size_t before = mallinfo2().uordblks;
  for (int i = 0; i < 100; ++i) make();
  const auto bytes = static_cast<double>(mallinfo2().uordblks - before) / 100;
  clones.clear();
  for (auto _ : state) {
    make();
    if (drops) clones.clear();
    if (clones.size() < 1000) continue;
    state.PauseTiming();
    clones.clear();
    state.ResumeTiming();
  }
  state.counters["chunks"] = static_cast<double>(ground.chunk_count());
  state.counters["m2"] = ground.resident_m2();
  state.counters["kB"] = bytes / 1000;
  state.counters["of_whole"] = bytes / static_cast<double>(ground.memory_bytes());
}

BENCHMARK_CAPTURE(clone, rigid, false, false)->Name("Clone/soilvdb/rigid")->Unit(kUs);
BENCHMARK_CAPTURE(clone, moving, true, false)->Name("Clone/soilvdb/moving")->Unit(kUs);
BENCHMARK_CAPTURE(clone, dropped, false, true)->Name("Clone/soilvdb/dropped")->Unit(kUs);

}  // namespace
}  // namespace soilvdb::bench
