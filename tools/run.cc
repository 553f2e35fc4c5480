// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb run: digs a scenario and writes what it asks for.
#include <fmt/format.h>
#include <sys/resource.h>
#include <tbb/global_control.h>
#include <tbb/info.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include "core/mesher.h"
#include "core/tracker.h"
#include "io/atomic_file.h"
#include "io/level_set_file.h"
#include "io/mesh_file.h"
#include "io/raster.h"
#include "io/report.h"
#include "io/scenario.h"
#include "io/site.h"
#include "io/snapshot.h"
#include "tools/child.h"
#include "tools/commands.h"
#include "tools/outputs.h"
#include "tools/progress.h"
#include "tools/run_folder.h"
#include "tools/schedule.h"
#include "tools/summary_text.h"
#include "tools/text.h"

namespace soilvdb::tools {

volatile std::sig_atomic_t stop_requested = 0;

namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

std::uint64_t peak_rss_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

io::Scenario read(const RunOptions& options) {
  std::optional<Progress> progress;
  io::Scenario scenario =
      io::read_scenario(options.scenario, [&](std::int64_t done, std::int64_t total) {
        if (!progress) progress.emplace("reading motions", total, "B");
        progress->update(done);
      });
  if (options.voxel_size_m) scenario.voxel_size_m = *options.voxel_size_m;
  return scenario;
}

/// Other programs' .vdb files crash OpenVDB when they are damaged; a child finds out.
void try_out(const io::Terrain& terrain) {
  const auto* level_set = std::get_if<io::LevelSetTerrain>(&terrain);
  if (!level_set || io::is_snapshot(level_set->file)) return;
  in_child(level_set->file, [&] {
    io::read_level_set(level_set->file);
    return std::string();
  });
}

fs::path folder_of(const RunOptions& options, const io::Scenario& scenario) {
  if (options.out) return *options.out;
  const std::string& name = scenario.name;
  if (name.empty() || name == "." || name == ".." || name.find('/') != std::string::npos)
    throw io::InputError(scenario.file, fmt::format("the name '{}' can't be that of a folder; "
                                                    "give --out DIR",
                                                    name));
  return fs::path("out") / name;
}

std::vector<Bucket> buckets(const io::Scenario& scenario) {
  std::vector<Bucket> all;
  for (const io::MachineInput& machine : scenario.machines) all.push_back(machine.bucket);
  return all;
}

/// When snapshots are due: at every multiple of an interval since the motion began.
class SnapshotClock {
 public:
  SnapshotClock(std::optional<double> every_s, const Schedule& schedule)
      : every_s_(every_s),
        begin_s_(schedule.begin_s()),
        slack_s_(1e-9 * (schedule.end_s() - schedule.begin_s())) {}

  /// Has one come due since the last time this said so?
  bool due(double time_s) {
    if (!every_s_) return false;
    const double count = std::floor((time_s + slack_s_ - begin_s_) / *every_s_);
    if (count <= count_) return false;
    count_ = count;
    return true;
  }

 private:
  std::optional<double> every_s_;
  double begin_s_, slack_s_, count_ = 0;
};

/// One run, from checked input to its last file.
class Run {
 public:
  Run(const RunOptions& options, io::Scenario scenario, Clock::time_point begin, int threads)
      : begin_(begin),
        options_(options),
        scenario_(std::move(scenario)),
        folder_(folder_of(options, scenario_)),
        site_(io::open_site(scenario_)),
        tracker_(*site_.soil, buckets(scenario_)),
        schedule_(scenario_.machines, options.updates, tracker_.tolerance_m()),
        change_before_m3_(site_.soil->change_m3()) {
    folder_.spare(scenario_.file);
    for (const auto& input : scenario_.inputs) folder_.spare(input);
    if (const auto* raster = std::get_if<io::RasterTerrain>(&scenario_.terrain))
      folder_.spare(raster->file);
    if (const auto* level_set = std::get_if<io::LevelSetTerrain>(&scenario_.terrain))
      folder_.spare(level_set->file);
    summary_.scenario = scenario_.name;
    summary_.voxel_size_m = scenario_.voxel_size_m;
    summary_.threads = threads;
    summary_.open_s = seconds_since(begin_);
  }

  void go() {
    for (const std::string& warning : scenario_.warnings)
      fmt::print(stderr, "soilvdb: warning: {}\n", warning);
    folder_.make();
    try {
      dig();
      finish();
    } catch (const NoGroundError& e) {
      folder_.unmake();
      if (folder_.files().empty()) throw io::InputError(scenario_.file, e.what());
      throw std::runtime_error(
          fmt::format("{}: {}; {}", scenario_.file.string(), e.what(), folder_.safe()));
    } catch (const std::exception& e) {
      folder_.unmake();
      throw std::runtime_error(fmt::format("{}; {}", e.what(), folder_.safe()));
    }
    print_summary(summary_, time_s_ - schedule_.begin_s(), folder_);
    if (stopped_)
      throw std::runtime_error(fmt::format("stopped by a signal at {} s of {} s; {}",
                                           time_text(time_s_), time_text(schedule_.end_s()),
                                           folder_.safe()));
  }

 private:
  /// The update loop.
  void dig() {
    io::UpdatesCsv csv(folder_.path() / kUpdatesName);
    Progress progress(scenario_.name, schedule_.total(), " updates");
    SnapshotClock snapshots(options_.snapshots ? scenario_.snapshot_every_s : std::nullopt,
                            schedule_);
    time_s_ = schedule_.begin_s();
    for (std::optional<Step> step = schedule_.next(); step;) {
      const Step now = *step;
      update(now, csv);
      progress.update(summary_.updates.count());
      step = schedule_.next();
      if (!now.ends_update) continue;
      stopped_ = stop_requested && step;
      if (stopped_) break;
      // All machines have come to this time: none has another update that ends with it.
      if ((!step || step->end_s > now.end_s) && snapshots.due(now.end_s))
        write_snapshot("soil_" + time_text(now.end_s) + ".vdb");
    }
    progress.clear();
    folder_.begin(kUpdatesName);
    csv.close();
    folder_.done(kUpdatesName);
  }

  void update(const Step& step, io::UpdatesCsv& csv) {
    const io::MachineInput& machine = scenario_.machines[step.machine];
    const Update result = tracker_.update(step.machine, *step.motion, step.begin_s, step.end_s);
    update_us_ += result.us;
    update_cut_m3_ += result.cut_m3;
    time_s_ = step.end_s;
    if (!step.ends_update) return;
    summary_.updates.add(update_us_);
    csv.add(step.end_s, machine.name, update_cut_m3_, result.bucket_m3, update_us_);
    update_us_ = update_cut_m3_ = 0;
  }

  void write_snapshot(const std::string& name) {
    tracker_.flush();
    const Ledger total = tracker_.total();
    io::write_snapshot(folder_.begin(name), site_,
                       {scenario_.name, time_s_, total.cut_m3(), total.captured_m3(),
                        total.displaced_m3(), total.dumped_m3()});
    folder_.done(name);
  }

  /// Everything that is written once, at the end.
  void finish() {
    tracker_.flush();
    const Soil& soil = *site_.soil;
    if (options_.snapshots) write_snapshot("soil_final.vdb");
    const bool dug = !soil.chunks().empty();
    if (!dug) fmt::print(stderr, "soilvdb: warning: no bucket met any soil\n");
    if (dug && options_.mesh && scenario_.mesh) {
      const std::string name = "soil_final." + *scenario_.mesh;
      io::write_mesh(folder_.begin(name), mesh_all(soil), soil.origin(), site_.crs_wkt);
      folder_.done(name);
    }
    if (dug && scenario_.raster_cell_m) {
      const std::string name = "soil_final.tif";
      write_surface_raster(folder_.begin(name), soil, resident_box(soil), *scenario_.raster_cell_m,
                           site_.crs_wkt);
      folder_.done(name);
    }
    summarise();
    summary_.files = folder_.files();
    summary_.files.push_back(kSummaryName);
    summary_.total_s = seconds_since(begin_);
    io::write_atomically(folder_.begin(kSummaryName), io::to_json(summary_));
    folder_.done(kSummaryName);
  }

  void summarise() {
    const Soil& soil = *site_.soil;
    const Ledger total = tracker_.total();
    summary_.cut_m3 = total.cut_m3();
    summary_.captured_m3 = total.captured_m3();
    summary_.displaced_m3 = total.displaced_m3();
    summary_.dumped_m3 = total.dumped_m3();
    summary_.ground_change_m3 = soil.change_m3() - change_before_m3_;
    summary_.residual_m3 = summary_.ground_change_m3 + summary_.cut_m3;
    for (std::size_t i = 0; i < scenario_.machines.size(); ++i) {
      const Ledger& ledger = tracker_.ledger(i);
      summary_.machines.push_back(
          {scenario_.machines[i].name, ledger.bucket_m3(), ledger.cut_m3()});
    }
    summary_.leaves = soil.chunks().size();
    summary_.active_voxels = soil.active_voxels();
    summary_.resident_m2 = soil.resident_m2();
    summary_.soil_bytes = soil.memory_bytes();
    summary_.state_hash = soil.state_hash();
    summary_.peak_rss_bytes = peak_rss_bytes();
  }

  Clock::time_point begin_;
  const RunOptions& options_;
  io::Scenario scenario_;
  RunFolder folder_;
  io::Site site_;
  Tracker tracker_;
  Schedule schedule_;
  double change_before_m3_;  ///< of a site that was dug before
  io::Summary summary_;
  double time_s_ = 0;                         ///< how far the motion has come
  double update_us_ = 0, update_cut_m3_ = 0;  ///< of the update under way
  bool stopped_ = false;
};

}  // namespace

void run(const RunOptions& options) {
  const Clock::time_point begin = Clock::now();
  io::Scenario scenario = read(options);
  try_out(scenario.terrain);  // before there are threads
  const int threads = options.threads > 0 ? options.threads : tbb::info::default_concurrency();
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  arena.execute([&] { Run(options, std::move(scenario), begin, threads).go(); });
}

}  // namespace soilvdb::tools
