// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// An excavator that digs, swings and tips: how long its updates take, and that what they come to
// depends neither on how many there are nor on the site's size. A shift of ten.
#include <fmt/core.h>

#include <algorithm>

#include "bench/earthmoving.h"
#include "bench/site.h"
#include "soilvdb/capacity.h"

namespace soilvdb::bench {
namespace {

constexpr double kCycle_s = 15;

/// It digs, curls, lifts, swings and tips onto a heap.
Motion cycle(int n) {
  std::vector<double> times;
  std::vector<Pose> poses;
  const auto add = [&](double s, double x, double y, double z, double pitch) {
    times.push_back(kCycle_s * n + s);
    poses.push_back({{x, y, z}, from_rpy(0, pitch, 0)});
  };
  const double y = 1.5 * (n % 3), deep = -0.35 * (n / 3 + 1);
  add(0, -3, y, 0.8, 0.35);
  add(2, -3, y, deep, 0.35);
  add(4.5, -0.8, y, deep, 0.2);
  add(6.5, 0.2, y, deep + 0.5, -1.3);
  add(8, 0, y, 2.2, -1.55);
  add(11, -1, 6, 2.2, -1.55);
  add(13, -1, 6, 2.2, 1.3);
  add(14.9, -3, y, 1.5, 0.35);
  return {times, poses};
}

struct Work {
  double load_m3 = 0;
  std::vector<double> us;
  std::int64_t residual = 0;
  Heights ground;
};

Work dig_cycles(double voxel_m, int cycles, int updates,
                std::shared_ptr<const InitialTerrain> base) {
  constexpr double kReach_m = 9;
  Ground ground(voxel_m, Vec3::Zero(), std::move(base));
  Tracker tracker(ground, {digger()}, loam());
  Work work;
  for (int n = 0; n < cycles; ++n) {
    const Motion motion = cycle(n);
    const double begin = motion.begin_s(), length = motion.end_s() - begin;
    for (int i = 0; i < updates; ++i) {
      const Update update = tracker.update(0, motion, begin + length * i / updates,
                                           begin + length * (i + 1) / updates);
      work.us.push_back(update.us);
      if (n == 0 && i == updates * 2 / 3) work.load_m3 = update.bucket_m3;  // as it swings
    }
    work.residual |= residual(tracker);
  }
  tracker.come_to_rest();
  work.residual |= residual(tracker);
  work.ground = heights(ground, static_cast<int>(kReach_m / voxel_m));
  return work;
}

double p99_us(Work work) { return quantile(work.us, 0.99); }

}  // namespace

void measure_cycles(const Options& options, Goals& goals) {
  const int n = options.quick ? 1 : 6;
  constexpr int kUpdates = 1500;
  const auto plane = [] { return make_plane(0, {0, 0}); };
  const Work fine = dig_cycles(0.05, n, kUpdates, plane());
  Csv csv(options.out / "cycle_updates.csv", "cycle,time_s,us");
  for (std::size_t i = 0; i < fine.us.size(); ++i)
    csv.row(fmt::format("{},{:.3f},{:.1f}", i / kUpdates,
                        kCycle_s * static_cast<double>(i % kUpdates) / kUpdates, fine.us[i]));
  goals.add({"an excavator's cycle at 100 Hz, 5 cm: p99 update", p99_us(fine) / 1e3, "ms", 5});
  goals.add({"the same, slowest update", *std::max_element(fine.us.begin(), fine.us.end()) / 1e3,
             "ms", 15});
  goals.add(
      {"the same, mass residual", static_cast<double>(std::abs(fine.residual)), "units", 0.0});
  const Capacity capacity = *Capacity::of(digger());
  const double holds_m3 = capacity.at(from_rpy(0, -1.55, 0), kSlope).volume_m3;
  goals.add({"the same, load as it swings over what it holds so, less 1",
             100 * (fine.load_m3 / holds_m3 - 1), "%", 0.5, -5.0,
             fmt::format("over the standard's heap {:.1f} %",
                         100 * (fine.load_m3 / capacity.heaped_m3() - 1))});

  const Work coarse = dig_cycles(0.05, n, 30, plane()), many = dig_cycles(0.05, n, 5000, plane());
  double moved = 0, differ = 0;
  for (std::size_t i = 0; i < many.ground.z.size(); ++i) {
    moved += std::abs(many.ground.z[i]);
    differ += std::abs(many.ground.z[i] - coarse.ground.z[i]);
  }
  goals.add({"load in 30 updates against 5000", 100 * std::abs(coarse.load_m3 / many.load_m3 - 1),
             "%", 0.5});
  goals.add({"heights in 30 updates against 5000, of what moved", 100 * differ / moved, "%", 2});

  const Work small = dig_cycles(0.05, 1, kUpdates, make_hills(20)),
             large = dig_cycles(0.05, 1, kUpdates, make_hills(10'000));
  goals.add(
      {"p99 update on a site of 10 km over one of 20 m", p99_us(large) / p99_us(small), "", 1.1});
}

void measure_shift(const Options& options, Goals& goals) {
  constexpr double kRate_hz = 10, kHours = 8;
  constexpr std::size_t kBatchTicks = 100;
  // A shift that would take longer is broken off, and what is left of it reckoned.
  const double most_s = options.quick ? 1 : 240;
  const std::vector<DigCycles> machines = fleet();
  Ground ground(0.05, Vec3::Zero(), make_hills(1000));
  Tracker tracker(ground, std::vector<Bucket>(machines.size(), digger()), loam());
  constexpr auto kTicks = static_cast<std::size_t>(kHours * 3600 * kRate_hz);
  const Stopwatch watch;
  std::vector<Move> moves;
  std::size_t tick = 0;
  while (tick < kTicks && watch.seconds() < most_s) {
    for (std::size_t m = 0; m < machines.size(); ++m) {
      // Machines are not in step with each other.
      const double time_s = static_cast<double>(tick) / kRate_hz + 1.9 * static_cast<double>(m);
      Move move;
      move.machine = m;
      move.to = machines[m].world_from_bucket(time_s);
      moves.push_back(move);
    }
    if (++tick % kBatchTicks != 0 && tick < kTicks) continue;
    tracker.update(moves);
    moves.clear();
  }
  const double part = static_cast<double>(tick) / kTicks;
  const Ledger total = tracker.total();
  goals.add({"shift of 10 machines, 8 h at 10 Hz, 1 km2, 5 cm, everything on",
             watch.seconds() / part,
             "s",
             90,
             {},
             fmt::format("{:.3f} h done, {:.0f} m3 dug, {:.0f} m3 put down", kHours * part,
                         total.cut_m3(), total.spilled_m3())});
  goals.add(
      {"the same, mass residual", static_cast<double>(std::abs(residual(tracker))), "units", 0.0});
}

}  // namespace soilvdb::bench
