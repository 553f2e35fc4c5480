// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// An excavator that digs, swings and tips: how long its updates take, and that what they come to
// depends neither on how many there are nor on the site's size. Whole places of a fleet's.
#include <fmt/core.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <ctime>

#include "bench/earthmoving.h"
#include "bench/site.h"
#include "soilvdb/capacity.h"
#include "tests/support/earthmoving_fixture.h"

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

/// CPU time of this process, s.
double cpu_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

/// Machines of the fleet at work, from the first cycle at their places on.
struct Fleet {
  double cpu_s = 0, wall_s = 0;
  double cut_m3 = 0, spilled_m3 = 0;
  std::int64_t residual = 0;
};
Fleet work(std::size_t machines, int cycles, int threads, Earthmoving earthmoving) {
  constexpr double kRate_hz = 10;
  constexpr int kBatchTicks = 100;
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  const std::vector<DigCycles> all = fleet();
  const bool moves_soil = earthmoving.soil.has_value();
  Ground ground(0.05, Vec3::Zero(), make_hills(1000));
  Tracker tracker(ground, std::vector<Bucket>(machines, digger()), std::move(earthmoving));
  const double cpu_before_s = cpu_s();
  const Stopwatch watch;
  std::vector<Move> moves;
  const int ticks = static_cast<int>(cycles * DigCycles::kCycle_s * kRate_hz);
  for (int tick = 0; tick < ticks;) {
    for (std::size_t m = 0; m < machines; ++m) {
      Move move;
      move.machine = m;
      move.to = all[m].world_from_bucket(tick / kRate_hz);
      moves.push_back(move);
    }
    if (++tick % kBatchTicks != 0 && tick < ticks) continue;
    tracker.update(moves);
    moves.clear();
  }
  const Ledger total = tracker.total();
  return {cpu_s() - cpu_before_s, watch.seconds(), total.cut_m3(), total.spilled_m3(),
          moves_soil ? residual(tracker) : 0};
}

/// 1 m3 of loose soil on a plane that is too steep for it, and a load tipped low there.
double slowest_on_slope_ms(double slope) {
  Earthmoving all = loam({{"heap", {0, 0, 3}, 0, 0, 1}});
  Ground ground(0.05, Vec3::Zero(), make_plane(0, {slope, 0}));
  Tracker tracker(ground, {digger()}, std::move(all));
  std::vector<double> us;
  Stopwatch watch;
  tracker.pour(0, 0);
  us.push_back(watch.us());
  for (const Pose& pose : test::cycle({4, 3, 4 * slope + 0.3}, 0.9, 200)) {
    watch = Stopwatch();
    tracker.update(0, pose);
    us.push_back(watch.us());
  }
  return *std::max_element(us.begin(), us.end()) / 1e3;
}

}  // namespace

void measure_cycles(const Options& options, Goals& goals) {
  const int n = options.quick ? 1 : 9;
  constexpr int kUpdates = 1500;
  const auto plane = [] { return make_plane(0, {0, 0}); };
  Work fine = dig_cycles(0.05, n, kUpdates, plane());
  Csv csv(options.out / "cycle_updates.csv", "cycle,time_s,us");
  for (std::size_t i = 0; i < fine.us.size(); ++i)
    csv.row(fmt::format("{},{:.3f},{:.1f}", i / kUpdates,
                        kCycle_s * static_cast<double>(i % kUpdates) / kUpdates, fine.us[i]));
  const std::string name = "an excavator's cycles at 100 Hz, 5 cm: ";
  goals.add({name + "p99 update", quantile(fine.us, 0.99) / 1e3, "ms", 1.5});
  goals.add({name + "p99.9", quantile(fine.us, 0.999) / 1e3, "ms", 3});
  goals.add({name + "slowest update", quantile(fine.us, 1) / 1e3, "ms", 6});
  goals.add({name + "mass residual", static_cast<double>(std::abs(fine.residual)), "units", 0.0});
  const Capacity capacity = *Capacity::of(digger());
  const double holds_m3 = capacity.at(from_rpy(0, -1.55, 0), kSlope).volume_m3;
  goals.add({name + "load as it swings over what it holds so, less 1",
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

  if (!options.quick) {
    Work finer = dig_cycles(0.025, 3, kUpdates, plane());
    goals.add(
        {"three cycles at 100 Hz, 2.5 cm: slowest update", quantile(finer.us, 1) / 1e3, "ms", 25});
  }
  for (const double slope : {0.9, 1.2})
    goals.add({fmt::format("1 m3 poured on a plane of slope {}, and a tip there: slowest", slope),
               slowest_on_slope_ms(slope), "ms", 25});

  const Work small = dig_cycles(0.05, 1, kUpdates, make_hills(20)),
             large = dig_cycles(0.05, 1, kUpdates, make_hills(10'000));
  goals.add(
      {"p99 update on a site of 10 km over one of 20 m", p99_us(large) / p99_us(small), "", 1.1});
}

void measure_fleet(const Options& options, Goals& goals) {
  const int cycles = options.quick ? 1 : DigCycles::kCyclesPerPlace;
  const std::size_t machines = options.quick ? 2 : 10;
  const Fleet one = work(machines, cycles, 1, loam()), two = work(machines, cycles, 2, loam()),
              rigid = work(machines, cycles, 1, Earthmoving{});
  const double all_cycles = static_cast<double>(machines) * cycles;
  goals.add({fmt::format("{} cycles at each of {} places at 10 Hz, 5 cm, one core: a cycle", cycles,
                         machines),
             1e3 * one.cpu_s / all_cycles,
             "ms of CPU",
             100,
             {},
             fmt::format("{:.1f} m3 dug, {:.1f} m3 put down; rigid soil {:.1f} ms", one.cut_m3,
                         one.spilled_m3, 1e3 * rigid.cpu_s / all_cycles)});
  goals.add({"the same, mass residual", static_cast<double>(std::abs(one.residual)), "units", 0.0});
  goals.add({"two threads over one", one.wall_s / two.wall_s, "", {}, 1.7});
  constexpr double kShift_s = 8 * 3600;
  goals.add({"ten machines on two cores, for as many cycles as a shift of 8 h has",
             two.wall_s / all_cycles * 10 * kShift_s / DigCycles::kCycle_s,
             "s",
             700,
             {},
             "reckoned from these"});
}

}  // namespace soilvdb::bench
