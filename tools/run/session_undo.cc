// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Takes a machine's states back: their recording is made anew without them.
#include "tools/run/session_undo.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <system_error>

#include "core/ground/ground_writer.h"
#include "io/file/atomic_file.h"
#include "soilvdb/chunk_range.h"
#include "tools/run/run_files.h"

namespace soilvdb::inline v0 {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr double kSyncAtEnd_s = 3600;

bool is_of(const io::JournalUpdate& update, std::size_t machine) {
  const bool of_machine = update.has_rows() || update.kind == io::JournalUpdate::Kind::kClock;
  return of_machine && update.machine == machine;
}

void note(const io::JournalUpdate& update, tools::SnapshotSchedule& schedule) {
  if (update.kind == io::JournalUpdate::Kind::kClock) schedule.begin_again();
  const bool rests = update.kind == io::JournalUpdate::Kind::kRest;
  if (std::isfinite(update.end_s) && !rests) schedule.due(update.end_s);
}

/// Calls `use(update, number before it)` for each update of a journal.
template <typename Use, typename Other>
void each_record(const fs::path& journal, const Use& use, const Other& other) {
  io::JournalReader reader(journal);
  std::uint64_t before = 0;
  while (const std::optional<io::JournalRecord> record = reader.next()) {
    const auto* update = std::get_if<io::JournalUpdate>(&*record);
    if (update == nullptr) {
      other(*record);
      continue;
    }
    use(*update, before);
    before += update->ends_update;
  }
}

/// Makes a ground equal to another, where it is not.
void become_equal(Ground& ground, const Ground& other) {
  std::vector<Coord3> origins = ground.origins();
  const std::vector<Coord3> others = other.origins();
  origins.insert(origins.end(), others.begin(), others.end());
  sort_once(origins);
  const auto same = [&](const Coord3& origin) {
    const Chunk *a = ground.find(origin), *b = other.find(origin);
    if (a == nullptr || b == nullptr) return false;
    if (a->soil_count != b->soil_count || a->loose_count != b->loose_count || a->above != b->above)
      return false;
    SampleWords words, other_words;
    for (const auto read : {&Ground::read_samples, &Ground::read_loose}) {
      (ground.*read)(origin, words);
      (other.*read)(origin, other_words);
      if (words != other_words) return false;
    }
    return true;
  };
  GroundWriter writer(ground);
  for (const Coord3& origin : origins)
    if (!same(origin)) writer.copy_from(other, origin);
}

}  // namespace

Undone::~Undone() {
  std::error_code none;
  fs::remove(journal, none);
}

StatesAfter Session::states_after(const fs::path& folder, std::size_t machine,
                                  double time_s) const {
  constexpr double kMorePasses = 3;  // over the journal, as those here; one of them writes
  const Clock::time_point begin = Clock::now();
  const fs::path journal = folder / tools::kJournalName;
  StatesAfter after{machine};
  after.before = io::updates_until(journal, time_s, static_cast<std::uint32_t>(machine));
  std::uint64_t from = 0;
  for (const io::JournalFile& file : io::read_journal(journal).files)
    if (tools::is_periodic(file.name) && file.updates <= after.before)
      from = std::max(from, file.updates);
  double work_ns = 0;
  const auto count = [&](const io::JournalUpdate& update, std::uint64_t before) {
    const bool is_after = before >= after.before, goes = is_after && is_of(update, machine);
    if (is_after && update.kind == io::JournalUpdate::Kind::kSurvey &&
        Site::is_of_scans(io::unpack_survey(update.survey)))
      throw std::invalid_argument(
          "scans corrected the ground since that time, and what they found can't be made anew");
    if (goes) after.states += update.has_rows();
    if (is_after && !goes) after.others += update.has_rows();
    if (!goes && before >= from) work_ns += static_cast<double>(update.ns);
  };
  each_record(journal, count, [](const io::JournalRecord&) {});
  const double passed_s = std::chrono::duration<double>(Clock::now() - begin).count();
  after.about_s = after.states > 0 ? 1e-9 * work_ns + kMorePasses * passed_s : 0;
  return after;
}

std::shared_ptr<Undone> Session::without(
    const fs::path& folder, const StatesAfter& states, std::optional<double> snapshot_every_s,
    const std::function<void(const io::JournalUpdate&)>& made) const {
  const fs::path journal = folder / tools::kJournalName;
  auto undone = std::make_shared<Undone>(at_update(folder, states.before),
                                         folder / fmt::format(".journal.{}-0.tmp", getpid()),
                                         snapshot_every_s);
  State& site = *undone->site.state_;
  {
    io::JournalWriter writer(undone->journal,
                             io::begin_journal(undone->journal, io::read_journal(journal).config),
                             {}, kSyncAtEnd_s);
    const auto add = [&](const io::JournalUpdate& update) {
      writer.add(update);
      note(update, undone->schedule);
      made(update);
    };
    const auto make = [&](const io::JournalUpdate& update, std::uint64_t before) {
      if (before < states.before) return add(update);
      if (is_of(update, states.machine)) return;
      if (const auto anew = site.make_anew(update)) add(*anew);
    };
    const auto copy = [&](const io::JournalRecord& record) {
      const auto* file = std::get_if<io::JournalFile>(&record);
      if (file != nullptr && file->updates <= states.before)
        writer.add(*file);
      else if (file != nullptr)
        writer.add(io::JournalRemoval{file->name});
      else if (const auto* removed = std::get_if<io::JournalRemoval>(&record))
        writer.add(*removed);
    };
    each_record(journal, make, copy);
    writer.flush();
  }
  undone->content = io::read_journal(undone->journal);
  undone->snapshots = tools::good_snapshots(folder, undone->content);
  return undone;
}

void Session::undo(Undone& undone) {
  State& s = *state_;
  if (!s.recorder) throw std::invalid_argument("only a recorded session takes states back");
  flush();
  const fs::path journal = s.folder->path() / tools::kJournalName;
  fs::rename(undone.journal, journal);  // this decides
  try {
    io::sync_folder(journal);
    s.recorder.reset();
    become_equal(*s.site.ground, *undone.site.state_->site.ground);
    s.rebuild(s.model(), undone.site.state_->progress());
    s.recorder = s.new_recorder(*s.folder, undone.schedule);
    s.recorder->skip(undone.content.done.updates);
    s.recorder->go_on(undone.content, undone.snapshots,
                      {nullptr, undone.content.done.updates, {}, {}});
    s.fed_count = undone.content.done.updates;
  } catch (const std::exception& e) {
    s.fail(e.what());
    throw std::runtime_error(s.broken_);
  }
}

}  // namespace soilvdb::inline v0
