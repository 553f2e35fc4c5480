// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/job.h"

#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <bit>
#include <cstdio>
#include <utility>
#include <vector>

#include "core/mesher.h"
#include "io/atomic_file.h"
#include "io/checksum.h"
#include "io/mesh_file.h"
#include "io/snapshot.h"
#include "tools/outputs.h"
#include "tools/summary_text.h"
#include "tools/text.h"

namespace soilvdb::tools {
namespace {

using Clock = Job::Clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

std::uint64_t peak_rss_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

bool same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

std::vector<Bucket> buckets(const io::Scenario& scenario) {
  std::vector<Bucket> all;
  for (const io::MachineInput& machine : scenario.machines) all.push_back(machine.bucket);
  return all;
}

std::vector<const Motion*> motions(const io::Scenario& scenario) {
  std::vector<const Motion*> all;
  for (const io::MachineInput& machine : scenario.machines) all.push_back(&machine.motion);
  return all;
}

/// Leaves out rows that say no more than their neighbours where an update covers several of them.
io::Scenario& thin_out(io::Scenario& scenario, const RunOptions& options, const Tracker& tracker) {
  for (io::MachineInput& machine : scenario.machines) {
    if (!options.updates ||
        machine.motion.times_s().size() <= 2 * static_cast<std::size_t>(*options.updates))
      continue;
    machine.motion = machine.motion.simplified(machine.bucket, tracker.tolerance_m());
  }
  return scenario;
}

}  // namespace

Job::Job(RunConfig config, io::Scenario scenario, RunFolder& folder, Start start, int threads,
         Clock::time_point begin)
    : begin_(begin),
      config_(std::move(config)),
      scenario_(std::move(scenario)),
      folder_(folder),
      start_(std::move(start)),
      tracker_(*start_.site.soil, buckets(scenario_)),
      schedule_(motions(thin_out(scenario_, config_.options, tracker_)), config_.options.updates),
      step_(schedule_.next()),
      snapshots_(config_.options.snapshots ? scenario_.snapshot_every_s : std::nullopt,
                 schedule_.begin_s(), schedule_.end_s()),
      progress_(scenario_.name, schedule_.total()),
      time_s_(schedule_.begin_s()) {
  if (start_.updates > 0) tracker_.restore(start_.tracker_state);
  summary_.scenario = scenario_.name;
  summary_.voxel_size_m = scenario_.voxel_size_m;
  summary_.threads = threads;
  summary_.open_s = seconds_since(begin_);
}

void Job::run() { guarded(&Job::dig); }

void Job::resume(const io::JournalContent& before) {
  before_ = before;
  guarded(&Job::replay_and_dig);
}

/// Runs the work and what comes after it, and tells what is safe if something goes wrong.
void Job::guarded(void (Job::*work)()) {
  try {
    csv_.emplace(folder_.path() / kUpdatesName);
    (this->*work)();
    progress_.clear();
    finish();
  } catch (const NoGroundError& e) {
    progress_.clear();
    csv_.reset();
    if (!journal_) throw io::InputError(scenario_.file, e.what());
    throw std::runtime_error(fmt::format("{}: {}; {}", scenario_.file.string(), e.what(), safe()));
  } catch (const std::exception& e) {
    progress_.clear();
    csv_.reset();
    throw std::runtime_error(fmt::format("{}; {}", e.what(), safe()));
  }
  print_summary(summary_, time_s_ - schedule_.begin_s(), folder_);
  if (stopped_)
    throw std::runtime_error(fmt::format("stopped by a signal at {} s of {} s; {}",
                                         time_text(time_s_), time_text(schedule_.end_s()), safe()));
}

void Job::replay_and_dig() {
  const std::filesystem::path file = folder_.begin(kJournalName);
  journal_.emplace(file, before_->good_bytes, before_->done, scenario_.journal_sync_s);
  io::JournalReader reader(file);  // now without what was torn
  while (const std::optional<io::JournalRecord> record = reader.next()) {
    const auto* move = std::get_if<io::JournalMove>(&*record);
    if (!move) continue;
    if (stop_requested) throw std::runtime_error("stopped by a signal before it was up to date");
    replay(*move);
  }
  dig();
}

/// One move of the journal.
void Job::replay(const io::JournalMove& move) {
  const auto count = static_cast<std::uint64_t>(summary_.updates.count());
  const auto refuse = [&](const std::string& why) {
    return std::runtime_error(fmt::format("{}: update {}, at {} s, {}",
                                          (folder_.path() / kJournalName).string(), count + 1,
                                          time_text(move.end_s), why));
  };
  if (!step_ || step_->machine != move.machine || !same_bits(step_->begin_s, move.begin_s) ||
      !same_bits(step_->end_s, move.end_s))
    throw refuse("is not the one that the scenario has in this place");
  if (count >= start_.updates) {
    const Chain& chain = scenario_.machines[move.machine].motion.chain();
    const Update result =
        tracker_.update(move.machine, io::motion_of(move.rows, chain), move.begin_s, move.end_s);
    if (!same_bits(result.cut_m3, move.cut_m3) || !same_bits(result.bucket_m3, move.bucket_m3))
      throw refuse(
          fmt::format("cut {} m³ and now cuts {} m³; it was another version of soilvdb "
                      "that dug it, or another machine",
                      move.cut_m3, result.cut_m3));
  }
  book(move);
  step_on(*step_);
}

/// The update loop.
void Job::dig() {
  while (step_ && !stopped_) {
    const Step now = *step_;
    const Motion& motion = scenario_.machines[now.machine].motion;
    const Update result = tracker_.update(now.machine, motion, now.begin_s, now.end_s);
    const io::JournalMove move{static_cast<std::uint32_t>(now.machine),
                               true,
                               now.begin_s,
                               now.end_s,
                               result.cut_m3,
                               result.bucket_m3,
                               result.us,
                               io::rows_between(motion, now.begin_s, now.end_s)};
    if (!journal_) {
      const std::filesystem::path file = folder_.begin(kJournalName);
      const std::uint64_t size = io::begin_journal(file, {to_bytes(config_, scenario_)});
      journal_.emplace(file, size, io::JournalExtent{0, schedule_.begin_s()},
                       scenario_.journal_sync_s);
    }
    journal_->add(move);
    book(move);
    step_on(now);
    stopped_ = stop_requested && step_;
  }
}

void Job::book(const io::JournalMove& move) {
  summary_.updates.add(move.us);
  csv_->add(move.end_s, scenario_.machines[move.machine].name, move.cut_m3, move.bucket_m3,
            move.us);
  time_s_ = move.end_s;
}

/// Goes on to the next step, with the snapshot that is due between.
void Job::step_on(Step now) {
  progress_.update(summary_.updates.count());
  step_ = schedule_.next();
  // All machines have come to this time: none has another update that ends with it.
  if ((!step_ || step_->end_s > now.end_s) && snapshots_.due(now.end_s))
    write_periodic("soil_" + time_text(now.end_s) + ".vdb");
}

/// A snapshot on the way, unless it is there already.
void Job::write_periodic(const std::string& name) {
  if (before_ && is_intact(name)) {
    folder_.done(name);
  } else if (static_cast<std::uint64_t>(summary_.updates.count()) >= start_.updates) {
    write_snapshot(name);
  } else {
    fmt::print(stderr, "soilvdb: warning: {}: is damaged or gone, and isn't written again\n",
               (folder_.path() / name).string());
  }
}

/// Does the journal know a file, of now, and is it still as it was?
bool Job::is_intact(const std::string& name) const {
  const auto count = static_cast<std::uint64_t>(summary_.updates.count());
  try {
    return std::any_of(before_->files.begin(), before_->files.end(), [&](const auto& file) {
      return file.name == name && file.updates == count &&
             io::file_digest(folder_.path() / name) == io::FileDigest{file.size, file.crc};
    });
  } catch (const io::InputError&) {
    return false;
  }
}

void Job::write_snapshot(const std::string& name) {
  tracker_.flush();
  const Ledger total = tracker_.total();
  io::write_snapshot(folder_.begin(name), start_.site,
                     {scenario_.name, time_s_, total.cut_m3(), total.captured_m3(),
                      total.displaced_m3(), total.dumped_m3(), tracker_.state()});
  done(name);
}

/// A file is whole and on disk.
void Job::done(const std::string& name) {
  folder_.done(name);
  const io::FileDigest digest = io::file_digest(folder_.path() / name);
  journal_->add(io::JournalFile{name, static_cast<std::uint64_t>(summary_.updates.count()),
                                digest.size, digest.crc});
}

/// Everything that is written once, at the end.
void Job::finish() {
  folder_.begin(kUpdatesName);
  csv_->close();
  done(kUpdatesName);
  tracker_.flush();
  if (config_.options.snapshots) write_snapshot("soil_final.vdb");
  if (start_.site.soil->chunks().empty()) {
    fmt::print(stderr, "soilvdb: warning: no bucket met any soil\n");
  } else {
    write_mesh();
    write_raster();
  }
  summarise();
  summary_.files = folder_.files();
  summary_.files.insert(summary_.files.end(), {kJournalName, kSummaryName});
  journal_->flush();
  summary_.acknowledged_updates = journal_->acknowledged().updates;
  summary_.acknowledged_s = journal_->acknowledged().time_s;
  summary_.total_s = seconds_since(begin_);
  io::write_atomically(folder_.begin(kSummaryName), io::to_json(summary_));
  done(kSummaryName);
  if (!stopped_) journal_->add(io::JournalEnd{});
  journal_->flush();
}

void Job::write_mesh() {
  if (!config_.options.mesh || !scenario_.mesh) return;
  const Soil& soil = *start_.site.soil;
  const std::string name = "soil_final." + *scenario_.mesh;
  io::write_mesh(folder_.begin(name), mesh_all(soil), soil.origin(), start_.site.crs_wkt);
  done(name);
}

void Job::write_raster() {
  if (!scenario_.raster_cell_m) return;
  const Soil& soil = *start_.site.soil;
  const std::string name = "soil_final.tif";
  write_surface_raster(folder_.begin(name), soil, resident_box(soil), *scenario_.raster_cell_m,
                       start_.site.crs_wkt);
  done(name);
}

void Job::summarise() {
  const Soil& soil = *start_.site.soil;
  const Ledger total = tracker_.total();
  summary_.cut_m3 = total.cut_m3();
  summary_.captured_m3 = total.captured_m3();
  summary_.displaced_m3 = total.displaced_m3();
  summary_.dumped_m3 = total.dumped_m3();
  summary_.ground_change_m3 = soil.change_m3() - config_.change_before_m3;
  summary_.residual_m3 = summary_.ground_change_m3 + summary_.cut_m3;
  for (std::size_t i = 0; i < scenario_.machines.size(); ++i) {
    const Ledger& ledger = tracker_.ledger(i);
    summary_.machines.push_back({scenario_.machines[i].name, ledger.bucket_m3(), ledger.cut_m3()});
  }
  summary_.leaves = soil.chunks().size();
  summary_.active_voxels = soil.active_voxels();
  summary_.resident_m2 = soil.resident_m2();
  summary_.soil_bytes = soil.memory_bytes();
  summary_.state_hash = soil.state_hash();
  summary_.peak_rss_bytes = peak_rss_bytes();
}

/// What is on disk, for messages.
std::string Job::safe() {
  if (!journal_) return folder_.safe();
  try {
    journal_->flush();
  } catch (const std::exception&) {  // the disk that is full may be why we are asked
  }
  const io::JournalExtent reached = journal_->acknowledged();
  return fmt::format("{}; `soilvdb resume {}` goes on from {} s", folder_.safe(),
                     folder_.path().string(), time_text(reached.time_s));
}

}  // namespace soilvdb::tools
