// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/job.h"

#include <fmt/format.h>

#include <bit>
#include <cstdio>
#include <utility>
#include <vector>

#include "tools/summary_text.h"
#include "tools/text.h"

namespace soilvdb::tools {
namespace {

using Clock = Job::Clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
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
