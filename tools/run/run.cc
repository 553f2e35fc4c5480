// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/run.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <utility>
#include <vector>

#include "io/snapshot/cold_file.h"
#include "tools/run/summary_text.h"
#include "tools/run/text.h"

namespace soilvdb::tools {

std::atomic<bool> stop_requested = false;
static_assert(std::atomic<bool>::is_always_lock_free, "it is set by signal handlers");

namespace {

using Clock = Run::Clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

/// Updates of each machine that are handed to the tracker at once, where there are several
/// machines.
constexpr std::size_t kRunBatch = 64;

constexpr double kNsPerUs = 1e3;

constexpr const char* kMended = "once that is mended ";

}  // namespace

Run::Run(RunConfig config, io::Scenario scenario, RunFolder& folder, Start start, int threads,
         Clock::time_point begin)
    : begin_(begin),
      config_(std::move(config)),
      scenario_(std::move(scenario)),
      folder_(folder),
      start_(std::move(start)),
      state_(*start_.state),
      tracker_(*state_.tracker),
      schedule_(scenario_, config_.options.updates, config_.ends_s, tracker_.tolerance_m()),
      step_(schedule_.next()),
      snapshots_(config_.options.snapshots ? scenario_.snapshot_every_s : std::nullopt,
                 schedule_.begin_s(), schedule_.end_s()),
      writer_(folder_, {scenario_.incremental_snapshots, scenario_.snapshots_kept, threads > 1}),
      progress_(scenario_.name, schedule_.total(), " updates"),
      time_s_(schedule_.begin_s()) {
  if (!step_) throw io::InputError(schedule_.stops_at());
  if (const auto mb = config_.options.memory_mb)
    state_.site.soil->limit_memory(static_cast<std::uint64_t>(*mb) << 20,
                                   std::make_shared<io::ColdFile>(folder_.path()));
  under_way_.resize(scenario_.machines.size() + scenario_.pours.size());
  if (scenario_.soil) {
    most_load_.resize(under_way_.size());
    if (start_.updates == 0) config_.mass_before = tracker_.site().ground;
  }
  summary_.scenario = scenario_.name;
  summary_.voxel_size_m = scenario_.voxel_size_m;
  summary_.threads = threads;
  summary_.open_s = seconds_since(begin_);
}

void Run::run() { guarded(&Run::dig); }

void Run::resume(const io::JournalContent& before) {
  before_ = before;
  guarded(&Run::replay_and_dig);
}

/// Runs the work and what comes after it, and tells what is safe if something goes wrong.
void Run::guarded(void (Run::*work)()) {
  try {
    csv_.emplace(folder_.path() / kUpdatesName, scenario_.soil.has_value());
    begin_recording();
    (this->*work)();
    progress_.clear();
    come_to_rest();
    finish();
  } catch (const NoGroundError& e) {
    progress_.clear();
    csv_.reset();
    mcap_.reset();
    if (!journal_) throw io::InputError(scenario_.file, e.what());
    throw std::runtime_error(
        fmt::format("{}: {}; {}", scenario_.file.string(), e.what(), safe(kMended)));
  } catch (const std::exception& e) {
    progress_.clear();
    csv_.reset();
    mcap_.reset();
    throw std::runtime_error(fmt::format("{}; {}", e.what(), safe(stop_requested ? "" : kMended)));
  }
  print_summary(summary_, time_s_ - schedule_.begin_s(), folder_);
  if (!stopped_) return;
  const std::string why = step_ ? "stopped by a signal"
                                : schedule_.stops_at() +
                                      "; mend or delete it, or leave out all bad rows by "
                                      "'bad_rows: skip'; stopped before it";
  throw std::runtime_error(fmt::format("{}, at {} s of {} s; {}", why, time_text(time_s_),
                                       time_text(schedule_.end_s()), safe()));
}

void Run::replay_and_dig() {
  const std::filesystem::path file = folder_.path() / kJournalName;
  journal_.emplace(file, before_->good_bytes, before_->done, scenario_.journal_sync_s);
  if (!before_->ended) {
    // Made anew it has other bytes, and until then it doesn't tell what is here.
    journal_->add(io::JournalRemoval{kSummaryName});
    journal_->flush();
    folder_.remove({kSummaryName});
    std::erase_if(before_->files, [](const auto& known) { return known.name == kSummaryName; });
  }
  go_on_with_snapshots();
  io::JournalReader reader(file);  // now without what was torn
  replay(reader);
  dig();
}

/// The journal's updates, as many at once as a run makes.
void Run::replay(io::JournalReader& reader) {
  const auto next_update = [&]() -> std::optional<io::JournalUpdate> {
    while (std::optional<io::JournalRecord> record = reader.next()) {
      if (auto* update = std::get_if<io::JournalUpdate>(&*record)) return std::move(*update);
    }
    return std::nullopt;
  };
  std::optional<io::JournalUpdate> ahead = next_update();
  while (ahead) {
    if (stop_requested) throw std::runtime_error("stopped by a signal before it was up to date");
    std::vector<io::JournalUpdate> updates;
    const auto first = static_cast<std::uint64_t>(summary_.updates.count());
    auto count = first;                         // updates before `ahead`
    const bool known = count < start_.updates;  // to the snapshot
    const auto take = [&] {
      if (!ahead || known != (count < start_.updates)) return false;
      if (!step_ || !is_update(*step_, *ahead))
        throw differs(count, *ahead,
                      UpdateDiffers(0, "is not the one that the scenario has in this place"));
      count += ahead->ends_update;
      updates.push_back(std::move(*ahead));
      ahead = next_update();
      return true;
    };
    take();
    const std::vector<Step> batch = next_batch(take);
    try {
      if (!known) state_.redo(updates);
    } catch (const UpdateDiffers& e) {
      const auto bad = updates.begin() + static_cast<std::ptrdiff_t>(e.index);
      const auto made = std::count_if(
          updates.begin(), bad, [](const io::JournalUpdate& update) { return update.ends_update; });
      throw differs(first + static_cast<std::uint64_t>(made), *bad, e);
    }
    for (const io::JournalUpdate& update : updates) book(update);
    after(batch.back());
  }
}

/// @param count updates before the journal's
std::runtime_error Run::differs(std::uint64_t count, const io::JournalUpdate& update,
                                const UpdateDiffers& why) const {
  return tools::differs(folder_.path() / kJournalName, count + 1, update.end_s, why);
}

/// The next steps, up to one that ground is written down after, or before one that isn't taken.
std::vector<Step> Run::next_batch(const std::function<bool()>& take) {
  const std::size_t machines = scenario_.machines.size();
  const std::size_t most = machines == 1 ? 1 : kRunBatch * machines;
  std::vector<Step> batch;
  do {
    batch.push_back(*step_);
    step_ = schedule_.next();
    if (all_came_to(batch.back()) && ground_would_be_due(batch.back().end_s)) break;
  } while (step_ && batch.size() < most && take());
  return batch;
}

/// The update loop.
void Run::dig() {
  while (step_ && !stopped_) {
    const std::vector<Step> batch = next_batch([] { return true; });
    std::vector<Move> moves;
    for (const Step& step : batch)
      moves.push_back({step.machine, {}, step.motion.get(), step.begin_s, step.end_s});
    const std::vector<Update> results = move_on(batch, moves);
    if (!journal_) begin_journal();
    for (std::size_t i = 0; i < batch.size(); ++i) {
      const Step& step = batch[i];
      const io::JournalUpdate update{
          .machine = static_cast<std::uint32_t>(step.machine),
          .ends_update = step.ends_update,
          .begin_s = step.begin_s,
          .end_s = step.end_s,
          .cut_samples = state_.samples(results[i].cut_m3),
          .bucket_samples = state_.mass(results[i].bucket_m3),
          .ns = std::llround(kNsPerUs * results[i].us),
          .rows = step.motion ? io::rows_between(*step.motion, step.begin_s, step.end_s)
                              : io::MotionRows(),
          .spilled = state_.mass(results[i].spilled_m3),
          .slid = state_.mass(results[i].slid_m3),
          .kind = step.motion ? io::JournalUpdate::Kind::kMove : io::JournalUpdate::Kind::kPour};
      journal_->add(update);
      state_.follow(update);
      book(update);
    }
    after(batch.back());
    stopped_ = stop_requested && step_ && batch.back().ends_update;
  }
  if (!step_) stopped_ = !schedule_.stops_at().empty();
}

/// From here on the folder is this run's.
void Run::begin_journal() {
  const std::filesystem::path file = folder_.path() / kJournalName;
  const std::uint64_t size =
      io::begin_journal(file, {to_bytes(config_, scenario_)}, folder_.replaced());
  journal_.emplace(file, size, io::JournalExtent{0, schedule_.begin_s()}, scenario_.journal_sync_s);
  folder_.remove(folder_.replaced());
  folder_.remove({kSummaryName});  // without its journal
}

void Run::book(const io::JournalUpdate& update) {
  time_s_ = update.end_s;
  UnderWay& sum = under_way_[update.machine];
  sum.ns += update.ns;
  sum.cut_samples += update.cut_samples;
  sum.spilled += update.spilled;
  sum.slid += update.slid;
  if (!update.ends_update) return;
  const double us = static_cast<double>(sum.ns) / kNsPerUs;
  summary_.updates.add(us);
  std::optional<io::UpdatesCsv::Moved> moved;
  if (scenario_.soil) {
    most_load_[update.machine] = std::max(most_load_[update.machine], update.bucket_samples);
    moved = {state_.kg(update.bucket_samples), state_.loose_m3(sum.spilled),
             state_.loose_m3(sum.slid)};
  }
  record_load(update, sum);
  csv_->add(update.end_s, name_of(update.machine), state_.volume_m3(sum.cut_samples),
            state_.loose_m3(update.bucket_samples), us, moved);
  sum = {};
}

/// Have all machines come to the end of this step: none has another update that ends with it?
bool Run::all_came_to(const Step& now) const {
  return now.ends_update && (!step_ || step_->end_s > now.end_s);
}

/// What is due between a step and the next.
void Run::after(const Step& now) {
  writer_.check();
  progress_.update(summary_.updates.count());
  if (mcap_ && all_came_to(now) && mcap_->due(now.end_s))
    mcap_->ground(now.end_s, take_changed(for_mcap_));
  if (all_came_to(now) && snapshots_.due(now.end_s))
    write_periodic("soil_" + time_text(now.end_s) + ".vdb");
}

}  // namespace soilvdb::tools
