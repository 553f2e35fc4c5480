// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Updates at 100 Hz while the mesh is kept up to date and snapshots are taken. Meshing and
// snapshots run between updates on the same thread for as long as core has no service thread for
// them: their own time is reported apart from the updates', whose caches they do disturb.
#include <fmt/core.h>

#include <algorithm>
#include <memory>

#include "bench/site.h"
#include "bench/speed.h"
#include "core/mesher.h"
#include "core/tracker.h"
#include "io/snapshot.h"

namespace soilvdb::bench {
namespace {

constexpr double kRate_hz = 100;

io::Site hilly_site(double voxel_m) {
  io::Site site;
  site.soil = std::make_unique<Soil>(voxel_m, Vec3::Zero(), make_hills(1000));
  return site;
}

/// A machine at work with mesh patches ten times and a snapshot once a second.
void latency(const Options& options, Goals& goals) {
  Csv csv(options.out / "latency.csv", "what,p50_us,p99_us,max_us,count");
  const io::Site site = hilly_site(0.05);
  Tracker tracker(*site.soil, {excavator_bucket()});
  SurfaceMesh mesh(*site.soil);
  const DigCycles machine = fleet().front();
  std::vector<double> all, cutting, meshing, snapshots;
  const int ticks = static_cast<int>(kRate_hz * (options.quick ? 20 : 600));
  for (int tick = 0; tick < ticks; ++tick) {
    const Pose pose = machine.world_from_bucket(tick / kRate_hz);
    const Stopwatch watch;
    const bool cut = tracker.update(0, pose).cut_m3 > 0;
    const double us = watch.us();
    all.push_back(us);
    if (cut) cutting.push_back(us);
    if (tick % 10 == 9) {
      const Stopwatch patch;
      mesh.update(tracker.take_changed());
      meshing.push_back(patch.us());
    }
    if (tick % 100 == 99) {
      const Stopwatch save;
      tracker.flush();
      io::snapshot_bytes(options.out / "latency.vdb", site, {});
      snapshots.push_back(save.us());
    }
  }
  const auto report = [&](const char* what, std::vector<double>& us) {
    csv.row(fmt::format("{},{:.4g},{:.4g},{:.4g},{}", what, quantile(us, 0.5), quantile(us, 0.99),
                        quantile(us, 1), us.size()));
  };
  report("update", all);
  report("update that cuts", cutting);
  report("mesh patches", meshing);
  report("snapshot", snapshots);
  const std::string cuts =
      fmt::format("p50 {:.1f} us, p99 {:.1f} us", quantile(cutting, 0.5), quantile(cutting, 0.99));
  goals.add({"100 Hz: p99 over median, updates that cut",
             quantile(cutting, 0.99) / quantile(cutting, 0.5),
             "x",
             3,
             {},
             cuts});
  goals.add({"100 Hz: slowest update",
             quantile(all, 1) / 1000,
             "ms",
             5,
             {},
             "mesh and snapshots between updates, same thread"});
}

/// One stroke's mesh patches and snapshot on a little and on a much dug site.
void services(const Options& options, Goals& goals) {
  Csv csv(options.out / "service.csv", "resident_m2,chunks,changed_chunks,mesh_us,snapshot_us");
  struct Cost {
    double mesh_us = 0, snapshot_us = 0;
  };
  const auto measure = [&](int cycles) {
    const io::Site site = hilly_site(0.05);
    Tracker tracker(*site.soil, {excavator_bucket()});
    SurfaceMesh mesh(*site.soil);
    const DigCycles machine = fleet().front();
    int tick = 0;
    for (; tick < cycles * 200; ++tick) tracker.update(0, machine.world_from_bucket(tick * 0.1));
    mesh.update(tracker.take_changed());
    for (int i = 0; i < 50; ++i, ++tick) tracker.update(0, machine.world_from_bucket(tick * 0.1));
    const auto changed = tracker.take_changed();
    const Stopwatch patch;
    mesh.update(changed);
    Cost cost;
    cost.mesh_us = patch.us();
    const Stopwatch save;
    io::snapshot_bytes(options.out / "service.vdb", site, {});
    cost.snapshot_us = save.us();
    csv.row(fmt::format("{:.6g},{},{},{:.6g},{:.6g}", site.soil->resident_m2(),
                        site.soil->chunks().size(), changed.size(), cost.mesh_us,
                        cost.snapshot_us));
    return cost;
  };
  const Cost little = measure(2);
  for (const int cycles : options.quick ? std::vector{5} : std::vector{10, 40}) measure(cycles);
  const int many = options.quick ? 10 : 160;
  const Cost much = measure(many);
  const std::string site = fmt::format("after {} cycles over after 2, one stroke since", many);
  goals.add({"mesh patches: much dug over little dug",
             much.mesh_us / little.mesh_us,
             "x",
             1.5,
             {},
             fmt::format("{}; {:.1f} ms", site, much.mesh_us / 1000)});
  goals.add({"snapshot: much dug over little dug",
             much.snapshot_us / little.snapshot_us,
             "x",
             1.5,
             {},
             fmt::format("{}; {:.1f} ms", site, much.snapshot_us / 1000)});
}

}  // namespace

void measure_latency(const Options& options, Goals& goals) {
  latency(options, goals);
  services(options, goals);
}

}  // namespace soilvdb::bench
