// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/run.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>

#include "io/snapshot/swap_file.h"
#include "tools/run/summary_text.h"
#include "tools/run/text.h"

namespace soilvdb::tools {

std::atomic<bool> stop_requested = false;
static_assert(std::atomic<bool>::is_always_lock_free, "it is set by signal handlers");

namespace {

/// Updates per machine in a batch of the tracker, if there are several machines.
constexpr std::size_t kRunBatch = 64;

constexpr const char* kMended = "once that is mended ";

}  // namespace

bool recording_is_whole(const io::Scenario& scenario, const io::JournalContent& journal,
                        std::uint64_t updates) {
  return !scenario.mcap ||
         std::any_of(journal.files.begin(), journal.files.end(), [&](const io::JournalFile& file) {
           return file.name == kMcapName && file.updates == updates;
         });
}

Run::Run(RunConfig config, io::Scenario scenario, RunFolder& folder, ResumePoint start, int threads,
         Clock::time_point begin)
    : config_(std::move(config)),
      scenario_(std::move(scenario)),
      folder_(folder),
      start_(std::move(start)),
      site_(*start_.state),
      schedule_(scenario_, config_.options.updates, config_.ends_s, site_.tracker().tolerance_m()),
      step_(schedule_.next()),
      recorder_(
          folder_, *site_.site.ground, scenario_.journal_sync_s,
          {scenario_.incremental_snapshots, scenario_.snapshots_kept, threads > 1},
          SnapshotSchedule(config_.options.snapshots ? scenario_.snapshot_every_s : std::nullopt,
                           schedule_.begin_s(), schedule_.end_s())),
      outputs_(config_, scenario_, folder_, site_, {schedule_.begin_s(), schedule_.end_s()},
               start_.updates == 0, threads, begin),
      progress_(scenario_.name, schedule_.total(), " updates"),
      time_s_(schedule_.begin_s()) {
  if (!step_) throw io::InputError(schedule_.stops_at());
  site_.records_force = scenario_.force;
  site_.scans = scenario_.scans;
  if (const auto mb = config_.options.memory_mb)
    site_.site.ground->set_memory_limit(static_cast<std::uint64_t>(*mb) << 20,
                                        std::make_shared<io::SwapFile>(folder_.path()));
  if (scenario_.soil && start_.updates == 0)
    config_.mass_before = site_.tracker().mass_balance().ground;
}

void Run::run() { guarded(&Run::dig); }

void Run::resume(io::JournalContent before) {
  before_ = std::move(before);
  guarded(&Run::replay_and_dig);
}

/// Runs the work and the outputs; adds to exceptions what is safe on disk.
void Run::guarded(void (Run::*work)()) {
  try {
    (this->*work)();
    progress_.clear();
    if (!stopped_) site_.rest_at_end(time_s_);
    finish();
  } catch (const NoGroundError& e) {
    progress_.clear();
    outputs_.drop();
    if (!recorder_.has_begun()) throw io::InputError(scenario_.file, e.what());
    throw std::runtime_error(
        fmt::format("{}: {}; {}", scenario_.file.string(), e.what(), safe(kMended)));
  } catch (const std::exception& e) {
    progress_.clear();
    outputs_.drop();
    throw std::runtime_error(fmt::format("{}; {}", e.what(), safe(stop_requested ? "" : kMended)));
  }
  print_summary(outputs_.summary(), time_s_ - schedule_.begin_s(), folder_);
  if (!stopped_) return;
  const std::string why = step_ ? "stopped by a signal"
                                : schedule_.stops_at() +
                                      "; mend or delete it, or leave out all bad rows by "
                                      "'bad_rows: skip'; stopped before it";
  throw std::runtime_error(fmt::format("{}, at {} s of {} s; {}", why, time_text(time_s_),
                                       time_text(schedule_.end_s()), safe()));
}

void Run::replay_and_dig() {
  const auto is_summary = [](const auto& known) { return known.name == kSummaryName; };
  std::vector<io::JournalFile> snapshots;
  for (const io::JournalFile& file : before_.files)
    if (is_periodic(file.name)) snapshots.push_back(file);
  recorder_.go_on(before_, snapshots, start_);
  if (!before_.ended) {
    // Its bytes will change, and until then it does not describe the folder.
    recorder_.journal().add(io::JournalRemoval{kSummaryName});
    recorder_.journal().flush();
    folder_.remove({kSummaryName});
    std::erase_if(before_.files, is_summary);
  }
  Step now;
  const auto ends = [&](const io::JournalUpdate&) {
    if (stop_requested) throw std::runtime_error("stopped by a signal before it had caught up");
    now = step_.value();
    step_ = schedule_.next();
    // Same batches as in the run, because the memory limit acts between batches.
    return scenario_.machines.size() == 1 || scenario_.force || ends_batch(now);
  };
  const auto made = [&](std::span<const io::JournalUpdate> updates) {
    for (const io::JournalUpdate& update : updates) {
      recorder_.note(update);
      outputs_.add(update);
    }
    after(now);
  };
  replay(folder_.path() / kJournalName, start_.updates, std::numeric_limits<std::uint64_t>::max(),
         site_, ends, made);
  dig();
}

void Run::dig() {
  while (step_ && !stopped_) {
    const std::vector<Step> batch = next_batch();
    const std::vector<io::JournalUpdate> updates = site_.advance(batch);
    if (!recorder_.has_begun()) begin_recording();
    for (const io::JournalUpdate& update : updates) {
      recorder_.add(update);
      outputs_.add(update);
    }
    after(batch.back());
    stopped_ = stop_requested && step_ && batch.back().ends_update;
  }
  if (!step_) stopped_ = !schedule_.stops_at().empty();
}

/// Makes the folder this run's.
void Run::begin_recording() {
  recorder_.begin({to_bytes(config_, scenario_)}, schedule_.begin_s());
  folder_.remove({kSummaryName});  // without its journal
}

/// The next steps, up to one after which the ground is recorded.
std::vector<Step> Run::next_batch() {
  const std::size_t machines = scenario_.machines.size();
  const std::size_t most = machines == 1 || scenario_.force ? 1 : kRunBatch * machines;
  std::vector<Step> batch;
  do {
    batch.push_back(*step_);
    step_ = schedule_.next();
  } while (step_ && batch.size() < most && !ends_batch(batch.back()));
  return batch;
}

bool Run::ends_batch(const Step& now) const {
  return all_came_to(now) &&
         (recorder_.would_be_due(now.end_s) || outputs_.would_be_due(now.end_s));
}

/// Did all machines reach the end of this step, with no other update that ends then?
bool Run::all_came_to(const Step& now) const {
  return now.ends_update && (!step_ || step_->end_s > now.end_s);
}

/// Work that is due between two steps.
void Run::after(const Step& now) {
  time_s_ = now.end_s;
  recorder_.check();
  progress_.update(outputs_.updates());
  if (!all_came_to(now)) return;
  outputs_.look(now.end_s);
  if (!recorder_.due(now.end_s)) return;
  // The snapshot that the ground was read from, and earlier ones, exist.
  const auto updates = static_cast<std::uint64_t>(outputs_.updates());
  if (updates < start_.updates || (updates == start_.updates && is_periodic(start_.snapshot)))
    return;
  io::SnapshotInfo info = site_.snapshot_info(now.end_s);
  info.scenario = scenario_.name;
  recorder_.write_snapshot(site_.site, std::move(info));
}

void Run::finish() {
  outputs_.finish(recorder_, before_.files, time_s_, stopped_);
  if (!stopped_ && !before_.ended) recorder_.journal().add(io::JournalEnd{});
  recorder_.flush();
}

/// The files on disk, for messages: "safe in out/dig: soil_1.vdb, soil_2.vdb, journal; `soilvdb
/// resume out/dig` goes on from 2.5 s".
std::string Run::safe(const std::string& before_going_on) {
  if (!recorder_.has_begun()) return "nothing of this run is on disk";
  recorder_.save_what_can_be();
  std::vector<std::string> files = folder_.files();
  files.push_back(kJournalName);
  const std::string folder = folder_.path().string();
  return fmt::format("safe in {}: {}; {}`soilvdb resume {}` goes on from {} s", folder,
                     fmt::join(files, ", "), before_going_on, folder,
                     time_text(recorder_.acknowledged().time_s));
}

}  // namespace soilvdb::tools
