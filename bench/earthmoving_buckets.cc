// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What buckets hold: by an integration of its own, and after a dig.
#include <fmt/core.h>

#include <algorithm>

#include "bench/earthmoving.h"
#include "soilvdb/capacity.h"
#include "tests/support/capacity_fixture.h"
#include "tests/support/filled_columns.h"

namespace soilvdb::bench {
namespace {

void capacities(const Options& options, Goals& goals) {
  test::Random random(1);
  const int cases = options.quick ? 5 : 200;
  double worst = 0;
  for (int i = 0; i < cases; ++i) {
    const Bucket bucket = random.bucket();
    const Eigen::Quaterniond attitude = random.machines_attitude();
    const double slope = random(0, 10) < 1 ? 0 : random(0.2, 1.4);
    const Capacity capacity = *Capacity::of(bucket);
    const double held_m3 = capacity.at(attitude, slope).volume_m3;
    // Of what is held, or of a twentieth of the bucket where that is less.
    const double unit_m3 = std::max(held_m3, capacity.struck_m3() / 20);
    const auto sum = test::FilledColumns(bucket, attitude, slope).sum(3e-7 * unit_m3);
    worst = std::max(worst, std::abs(held_m3 - sum.volume_m3) / unit_m3);
  }
  goals.add({fmt::format("capacity, {} random profiles and attitudes, worst", cases), 100 * worst,
             "%", 0.1});
}

/// Digs far more than it holds, curls until the mouth is level, and lifts. @return load, m3
double dug_m3(const Bucket& bucket, double repose_rad, double voxel_m) {
  Earthmoving earthmoving = loam();
  earthmoving.soil->repose_rad = repose_rad;
  Ground ground(voxel_m, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {bucket}, earthmoving);
  const double level = -std::numbers::pi / 2;
  const struct {
    double s, x, z, pitch;
  } rows[] = {{0, -3, 0.8, 0.35},   {2, -3, -0.35, 0.35}, {5, 0.5, -0.35, 0.2},
              {7, 1, -0.35, level}, {9, 1, 1.5, level},   {10, 1, 1.5, level}};
  std::vector<double> times;
  std::vector<Pose> poses;
  for (const auto& row : rows) {
    times.push_back(row.s);
    poses.push_back({{row.x, 0, row.z}, from_rpy(0, row.pitch, 0)});
  }
  const Motion motion(times, poses);
  constexpr int kUpdates = 1000;
  for (int i = 0; i < kUpdates; ++i)
    tracker.update(0, motion, motion.end_s() * i / kUpdates, motion.end_s() * (i + 1) / kUpdates);
  return tracker.total().bucket_m3();
}

void curled_full(Goals& goals) {
  const Bucket bucket = digger();
  const Capacity capacity = *Capacity::of(bucket);
  // The standard's heap is as steep as this soil's; other soil heaps up less.
  const auto row = [&](const std::string& what, double load_m3, double heaped_m3) {
    goals.add({"bucket curled full and level, " + what, 100 * (load_m3 / heaped_m3 - 1), "%", 0.5,
               -5.0, fmt::format("{:.3f} m3 of {:.3f}", load_m3, heaped_m3)});
  };
  const auto level = from_rpy(0, -std::numbers::pi / 2, 0);
  row("soil of 45 degrees: load over heaped capacity, less 1", dug_m3(bucket, 45 * kDegree, 0.05),
      capacity.heaped_m3());
  row("soil of 35 degrees: load over its own heap, less 1", dug_m3(bucket, kRepose, 0.05),
      capacity.at(level, kSlope).volume_m3);
  goals.add({"its own heap at 35 degrees over the standard's, less 1",
             100 * (capacity.at(level, kSlope).volume_m3 / capacity.heaped_m3() - 1), "%"});
}

}  // namespace

void measure_buckets(const Options& options, Goals& goals) {
  capacities(options, goals);
  curled_full(goals);
}

}  // namespace soilvdb::bench
