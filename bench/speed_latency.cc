// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Updates at 100 Hz, paced in real time, while meshes and snapshots are made beside them; and what
// those cost on little and on much dug ground.
#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <deque>
#include <map>
#include <memory>
#include <span>
#include <thread>

#include "bench/site.h"
#include "bench/speed.h"
#include "core/ground/ground_writer.h"
#include "soilvdb/change_follower.h"
#include "soilvdb/ground_copy.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/mesher.h"
#include "soilvdb/tracker.h"

namespace soilvdb::bench {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kRate_hz = 100, kPosts_hz = 10, kSnapshots_hz = 1;

double us_since(Clock::time_point then) {
  return std::chrono::duration<double, std::micro>(Clock::now() - then).count();
}

io::Site hilly_site() {
  io::Site site;
  site.ground = std::make_unique<Ground>(0.05, Vec3::Zero(), make_hills(1000));
  return site;
}

/// Times in us, of which each is one row of latency.csv.
struct Latencies {
  std::vector<double> update, cutting;
  std::vector<double> with_post;  ///< update, list and post, where there was one
  std::vector<double> listing, post;
  std::vector<double> ask;       ///< for a snapshot
  std::vector<double> patch;     ///< from the oldest post it brings news of until it was taken
  std::vector<double> snapshot;  ///< of its own thread
  std::uint64_t posted_chunks = 0;
};

/// Meshes blocks that changed in jobs on a copy, some at a time, as who shows them would.
class Patches {
 public:
  explicit Patches(const Ground& copy) : mesher_(copy) {}

  /// @param posted when those chunks were
  void want(std::span<const Coord3> chunks, Clock::time_point posted) {
    for (const Coord3& block : blocks_touched(chunks))
      if (posted_.try_emplace(block, posted).second) wanted_.push_back(block);
  }
  /// Takes what has been meshed, and asks for the next.
  /// @param us gets how long ago the oldest post was that each brings news of
  /// @return whether there is more to come
  bool go_on(GroundCopy& ground_copy, std::vector<double>& us) {
    constexpr std::size_t kAtOnce = 8;
    if (!ground_copy.done()) return true;
    for (const Clock::time_point posted : under_way_) us.push_back(us_since(posted));
    under_way_.clear();
    std::vector<Coord3> blocks;
    for (; !wanted_.empty() && blocks.size() < kAtOnce; wanted_.pop_front()) {
      blocks.push_back(wanted_.front());
      under_way_.push_back(posted_.extract(wanted_.front()).mapped());
    }
    if (blocks.empty()) return false;
    ground_copy.run([this, blocks] {
      for (const Coord3& block : blocks) mesher_.block(block);
    });
    return true;
  }

 private:
  CachedMesher mesher_;  // of jobs
  std::deque<Coord3> wanted_;
  std::map<Coord3, Clock::time_point, Before> posted_;  // the same
  std::vector<Clock::time_point> under_way_;
};

/// A machine at work in real time.
/// @param beside mesh patches ten times and a snapshot once a second; else nothing
Latencies work(const std::filesystem::path& folder, int seconds, bool beside) {
  Latencies times;
  const io::Site site = hilly_site(), copy = io::undug_site(site);
  Tracker tracker(*site.ground, {excavator_bucket()});
  ChangeFollower changes(*site.ground);
  Patches patches(*copy.ground);
  GroundCopy ground_copy(*copy.ground);
  const DigCycles machine = fleet().front();
  const Clock::time_point start = Clock::now();
  for (int tick = 0; tick < kRate_hz * seconds; ++tick) {
    const auto due = start + tick * std::chrono::microseconds(1000000 / kRate_hz);
    while (Clock::now() + std::chrono::milliseconds(1) < due) {
      patches.go_on(ground_copy, times.patch);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    std::this_thread::sleep_until(due);
    const Pose pose = machine.world_from_bucket(double(tick) / kRate_hz);
    const Stopwatch since;
    const bool cut = tracker.update(0, pose).cut_m3 > 0;
    times.update.push_back(since.us());
    if (cut) times.cutting.push_back(times.update.back());
    if (!beside) continue;
    const auto comes = [&](int rate_hz) { return (tick + 1) % (kRate_hz / rate_hz) == 0; };
    if (comes(kPosts_hz)) {
      const Clock::time_point updated = Clock::now();
      const std::vector<Coord3> changed = changes.take();
      times.listing.push_back(us_since(updated));
      const Stopwatch posting;
      ground_copy.post(*site.ground, changed);
      times.post.push_back(posting.us());
      times.with_post.push_back(since.us());
      times.posted_chunks += changed.size();
      patches.want(changed, updated);
    }
    if (comes(kSnapshots_hz)) {
      const Stopwatch asking;
      ground_copy.run([&] {
        const Stopwatch watch;
        io::write_snapshot(folder / "latency.vdb", copy, {});
        times.snapshot.push_back(watch.us());
      });
      times.ask.push_back(asking.us());
    }
  }
  while (patches.go_on(ground_copy, times.patch)) ground_copy.finish();
  return times;
}

void latency(const Options& options, Goals& goals) {
  Csv csv(options.out / "latency.csv", "what,p50_us,p99_us,max_us,count");
  const auto report = [&](const std::string& what, std::vector<double>& us) {
    if (us.empty()) return;
    csv.row(fmt::format("{},{:.4g},{:.4g},{:.4g},{}", what, quantile(us, 0.5), quantile(us, 0.99),
                        quantile(us, 1), us.size()));
  };
  const int seconds = options.quick ? 1 : 200;
  Latencies alone = work(options.out, seconds, false), times = work(options.out, seconds, true);
  report("update with nothing beside it", alone.update);
  report("update that cuts with nothing beside it", alone.cutting);
  report("update", times.update);
  report("update that cuts", times.cutting);
  report("update with post", times.with_post);
  report("list of what changed", times.listing);
  report("post", times.post);
  report("asking for a snapshot", times.ask);
  report("patch after its post", times.patch);
  report("snapshot on its thread", times.snapshot);
  const auto note = [](std::vector<double>& us) {
    return fmt::format("p50 {:.1f} us, p99 {:.1f} us, most {:.1f} us", quantile(us, 0.5),
                       quantile(us, 0.99), quantile(us, 1));
  };
  const auto p99_over_median = [](std::vector<double>& us) {
    return quantile(us, 0.99) / quantile(us, 0.5);
  };
  goals.add({"100 Hz, meshes and snapshots beside: p99 over median, cutting",
             p99_over_median(times.cutting),
             "x",
             3,
             {},
             note(times.cutting)});
  goals.add({"the same with nothing beside",
             p99_over_median(alone.cutting),
             "x",
             {},
             {},
             note(alone.cutting)});
  goals.add({"100 Hz: slowest update, post included",
             std::max(quantile(times.update, 1), quantile(times.with_post, 1)) / 1000,
             "ms",
             5,
             {},
             "update alone " + note(times.update)});
  goals.add(
      {"post of changed chunks, p99",
       quantile(times.post, 0.99),
       "us",
       {},
       {},
       fmt::format("{}; {:.0f} chunks on average; list before it {}", note(times.post),
                   double(times.posted_chunks) / double(times.post.size()), note(times.listing))});
  goals.add({"patch taken after its post, p99",
             quantile(times.patch, 0.99) / 1000,
             "ms",
             {},
             {},
             note(times.patch)});
}

/// What meshes and snapshots cost after a number of dig cycles.
struct Cost {
  double mesh_us = 0;      ///< per block
  double snapshot_us = 0;  ///< whole
  double part_us = 0;      ///< incremental, per chunk that changed
};

Cost cost_after(int cycles, const std::filesystem::path& folder, Csv& csv) {
  constexpr int kStrokes = 5, kDigUpdates = 50, kUpdatesPerCycle = 200;
  const io::Site site = hilly_site(), copy = io::undug_site(site);
  Tracker tracker(*site.ground, {excavator_bucket()});
  ChangeFollower changes(*site.ground);
  CachedMesher mesher(*copy.ground);
  GroundCopy ground_copy(*copy.ground, /*thread=*/false);
  std::size_t blocks = 0;
  const auto follow = [&](const std::vector<Coord3>& changed) {
    ground_copy.post(*site.ground, changed);
    ground_copy.run([&] {
      for (const Coord3& block : blocks_touched(changed)) {
        mesher.block(block);
        ++blocks;
      }
    });
  };
  const DigCycles machine = fleet().front();
  const auto dig = [&](int cycle, int from, int to) {
    for (int i = from; i < to; ++i)
      tracker.update(0, machine.world_from_bucket(0.1 * (cycle * kUpdatesPerCycle + i)));
  };
  for (int cycle = 0; cycle < cycles; ++cycle) dig(cycle, 0, kUpdatesPerCycle);
  follow(changes.take());
  blocks = 0;
  std::size_t changed_chunks = 0;
  double mesh_us = 0, part_us = 0;
  for (int i = 0; i < kStrokes; ++i) {
    dig(cycles + i, 0, kDigUpdates);
    const std::vector<Coord3> changed = changes.take();
    changed_chunks += changed.size();
    const Stopwatch watch;
    follow(changed);
    mesh_us += watch.us();
    const Stopwatch save_part;
    io::SnapshotInfo info;
    info.parent = io::SnapshotParent{"before.vdb", {}};
    const io::Site part = io::undug_site(site);
    for (const Coord3& origin : changed) {
      GroundWriter(*part.ground).copy_from(*site.ground, origin);
      if (site.ground->find(origin) == nullptr) info.parent->dropped.push_back(origin);
    }
    io::snapshot_bytes(folder / "service.vdb", part, info);
    part_us += save_part.us();
    dig(cycles + i, kDigUpdates, kUpdatesPerCycle);
  }
  Cost cost;
  cost.mesh_us = mesh_us / static_cast<double>(blocks);
  const Stopwatch save;
  ground_copy.run([&] { io::snapshot_bytes(folder / "service.vdb", copy, {}); });
  cost.snapshot_us = save.us();
  cost.part_us = part_us / static_cast<double>(changed_chunks);
  csv.row(fmt::format("{:.6g},{},{},{},{:.6g},{:.6g},{:.6g}", site.ground->resident_m2(),
                      site.ground->chunks().size(), changed_chunks, blocks, cost.mesh_us,
                      cost.snapshot_us, cost.part_us));
  return cost;
}

void services(const Options& options, Goals& goals) {
  Csv csv(options.out / "service.csv",
          "resident_m2,chunks,changed_chunks,blocks,mesh_us_per_block,snapshot_us,incremental_us_"
          "per_chunk");
  const Cost little = cost_after(2, options.out, csv);
  for (const int cycles : options.quick ? std::vector{1} : std::vector{10, 40})
    cost_after(cycles, options.out, csv);
  const int many = options.quick ? 2 : 160;
  const Cost much = cost_after(many, options.out, csv);
  const std::string cycles = fmt::format("after {} cycles over after 2", many);
  goals.add({"meshing a block that changed: much dug over little dug",
             much.mesh_us / little.mesh_us,
             "x",
             1.5,
             {},
             fmt::format("{}; {:.2f} ms", cycles, much.mesh_us / 1000)});
  goals.add({"incremental snapshot, per changed chunk: much dug over little dug",
             much.part_us / little.part_us,
             "x",
             1.5,
             {},
             fmt::format("{}; {:.1f} us, copying included", cycles, much.part_us)});
  goals.add({"snapshot, whole: much dug over little dug",
             much.snapshot_us / little.snapshot_us,
             "x",
             {},
             {},
             fmt::format("{}; {:.1f} ms, beside updates", cycles, much.snapshot_us / 1000)});
}

}  // namespace

void measure_latency(const Options& options, Goals& goals) {
  latency(options, goals);
  services(options, goals);
}

}  // namespace soilvdb::bench
