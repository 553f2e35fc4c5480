// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>
#include <sys/wait.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <stdexcept>
#include <type_traits>

#include "bench/site.h"
#include "bench/speed.h"
#include "soilvdb/tracker.h"

namespace soilvdb::bench {
namespace {

struct Replay {
  double seconds = 0, cut_m3 = 0, memory_bytes = 0, resident_m2 = 0, rss_bytes = 0;
  std::uint64_t hash = 0;
  std::size_t updates = 0, cutting = 0;
};

/// Ten machines at 10 Hz for a while, one update per machine and tick, handed over in batches of
/// ten seconds. Poses are made between batches, which is not timed.
Replay replay(double voxel_m, double hours, int threads) {
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  constexpr double kStates_hz = 10;
  constexpr std::size_t kBatchTicks = 100;
  const double rss = rss_bytes();
  const std::vector<DigCycles> machines = fleet();
  Ground ground(voxel_m, Vec3::Zero(), make_hills(1000));
  Tracker tracker(ground, std::vector<Bucket>(machines.size(), excavator_bucket()));
  Replay r;
  const auto ticks = static_cast<std::size_t>(hours * 3600 * kStates_hz);
  std::vector<Move> moves;
  for (std::size_t tick = 0; tick < ticks; ++tick) {
    for (std::size_t m = 0; m < machines.size(); ++m) {
      // Machines are not in step with each other.
      const double time_s = static_cast<double>(tick) / kStates_hz + 1.9 * static_cast<double>(m);
      Move move;
      move.machine = m;
      move.to = machines[m].world_from_bucket(time_s);
      moves.push_back(move);
    }
    if (tick % kBatchTicks != 0 && tick + 1 < ticks) continue;
    const Stopwatch watch;
    const std::vector<Update> updates = tracker.update(moves);
    r.seconds += watch.seconds();
    for (const Update& update : updates) r.cutting += update.cut_m3 > 0;
    r.updates += moves.size();
    moves.clear();
  }
  r.cut_m3 = tracker.total().cut_m3();
  r.memory_bytes = static_cast<double>(ground.memory_bytes());
  r.resident_m2 = ground.resident_m2();
  r.rss_bytes = rss_bytes() - rss;
  r.hash = ground.state_hash();
  return r;
}

/// A replay in a process that has used no memory before: its pages are all fresh.
template <typename F>
Replay in_child(F f) {
  static_assert(std::is_trivially_copyable_v<Replay>);
  int ends[2];
  if (pipe(ends) != 0) throw std::runtime_error("no pipe");
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error("no child process");
  Replay r;
  if (child == 0) {
    r = f();
    _exit(write(ends[1], &r, sizeof(r)) == sizeof(r) ? 0 : 1);
  }
  close(ends[1]);
  const bool good = read(ends[0], &r, sizeof(r)) == sizeof(r);
  close(ends[0]);
  waitpid(child, nullptr, 0);
  if (!good) throw std::runtime_error("the replay in a process of its own failed");
  return r;
}

}  // namespace

void measure_replay(const Options& options, Goals& goals) {
  Csv csv(
      options.out / "replay.csv",
      "voxel_m,hours,threads,seconds,updates,cutting,cut_m3,memory_bytes,resident_m2,rss_growth_"
      "bytes,state_hash");
  const auto measure = [&](double voxel, double hours, int threads) {
    const Replay r = replay(voxel, hours, threads);
    csv.row(fmt::format("{},{},{},{:.4g},{},{},{:.9g},{:.0f},{:.6g},{:.0f},{:016x}", voxel, hours,
                        threads, r.seconds, r.updates, r.cutting, r.cut_m3, r.memory_bytes,
                        r.resident_m2, r.rss_bytes, r.hash));
    return r;
  };
  const double hours = options.quick ? 0.01 : 8;
  const Replay two = measure(0.05, hours, 2);
  const Replay one = measure(0.05, options.quick ? hours : hours / 8, 1);
  const Replay again = options.quick ? two : measure(0.05, hours / 8, 2);
  const double shift_s = two.seconds * 8 / hours;
  goals.add(
      {"shift of 10 machines, 8 h at 10 Hz, 1 km2, 5 cm",
       shift_s,
       "s",
       30,
       {},
       fmt::format("{} updates, {:.0f} % cutting, {:.0f} m3{}", two.updates,
                   100.0 * static_cast<double>(two.cutting) / static_cast<double>(two.updates),
                   two.cut_m3, options.quick ? ", scaled up" : "")});
  goals.add({"2 threads over 1, replay of 10 machines",
             one.seconds / again.seconds,
             "x",
             {},
             1.7,
             one.hash == again.hash ? "same bits" : "BITS DIFFER"});
  goals.add({"memory per m2 touched at 5 cm", two.memory_bytes / two.resident_m2 / 1000, "kB", 30});
}

void measure_memory(const Options& options, Goals& goals) {
  const Replay r = in_child([&] { return replay(0.025, options.quick ? 0.002 : 0.5, 1); });
  goals.add({"memory per m2 touched at 2.5 cm", r.memory_bytes / r.resident_m2 / 1000, "kB", 100});
  if (options.quick) return;  // what the program is of takes more than the ground
  goals.add({"memory accounted over growth of the resident set, 2.5 cm",
             r.memory_bytes / r.rss_bytes, "x", 1.05, 0.95,
             fmt::format("{:.0f} MB, in a process of its own", r.memory_bytes / 1e6)});
}

}  // namespace soilvdb::bench
