// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A session that is recorded to a folder, and gone on with from there.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "io/file/json.h"
#include "io/snapshot/cold_file.h"
#include "soilvdb/io/error.h"
#include "soilvdb/version.h"
#include "tools/run/run_config.h"
#include "tools/run/run_files.h"
#include "tools/run/session_state.h"
#include "tools/run/text.h"

namespace soilvdb::inline v0 {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using tools::kJournalName;

constexpr int kRecordFormat = 1;
/// States that are dug at once while a recording is gone on with.
constexpr std::size_t kRecordBatch = 256;

/// @throw io::InputError unless a journal is of a session of this site
void require_same_site(const std::string& config, const Json& site, const fs::path& folder) {
  if (!tools::is_of_session(config))
    throw io::InputError(folder,
                         "holds a run of `soilvdb run`, which `soilvdb resume` goes on with; name "
                         "another folder");
  const Json before = io::from_cbor(config);
  if (before["session"] != kRecordFormat)
    throw io::InputError(folder, fmt::format("is a recording of format {}; this version goes on "
                                             "with format {}",
                                             io::to_text(before["session"]), kRecordFormat));
  if (const std::string what = difference(before["site"], site); !what.empty())
    throw io::InputError(
        folder, fmt::format("is a recording of another site, {} isn't the same; name another "
                            "folder",
                            what));
}

[[noreturn]] void differs(const fs::path& journal, std::uint64_t update, double time_s,
                          const std::string& why) {
  throw std::runtime_error(fmt::format(
      "{}: update {}, at {} s, {}; it was another version of soilvdb that dug it, or the site "
      "isn't as it was",
      journal.string(), update, tools::time_text(time_s), why));
}

}  // namespace

/// The newest good ground of a recording, and what leads there.
struct Session::State::Found {
  std::uint64_t updates = 0;
  std::vector<io::JournalFile> files = {};
  std::optional<io::SnapshotParent> parent = {};
};

/// Goes on to the newest snapshot that is good, if there is one.
Session::State::Found Session::State::find_start(const fs::path& folder,
                                                 const io::JournalContent& journal) {
  Found found;
  std::vector<io::JournalFile> good;
  for (const tools::RunFile& file : tools::check_files(folder, journal))
    if (file.fault.empty() && tools::is_periodic(file.known.name)) good.push_back(file.known);
  for (; !good.empty(); good.pop_back()) {
    try {
      io::SnapshotInfo info;
      State there(machines, earthmoving, io::read_snapshot(folder / good.back().name, &info));
      there.set_progress(info.tracker_state);
      there.recording = recording;
      there.scenario = scenario;
      there.memory_bytes = memory_bytes;
      there.cold_folder = cold_folder;
      there.limit_memory();
      there.note_changes();
      *this = std::move(there);
      return {good.back().updates, std::move(good), info.parent};
    } catch (const io::InputError&) {
    } catch (const std::invalid_argument&) {
    }  // the journal holds what it held, too
  }
  return found;
}

/// Feeds what a journal holds beyond a snapshot, up to so many updates.
void Session::replay(const fs::path& journal, std::uint64_t from, std::uint64_t to,
                     tools::SnapshotSchedule& schedule,
                     const std::function<void(const io::JournalExtent&)>& progress) {
  io::JournalReader reader(journal);
  io::JournalExtent at;
  std::vector<io::JournalState> batch;
  const auto feed = [&] {
    if (batch.empty()) return;
    const std::uint64_t before = at.updates - batch.size();
    std::vector<MachineState> states;
    for (const io::JournalState& fed : batch) {
      MachineState& state = states.emplace_back();
      state.machine = fed.machine;
      state.time_s = fed.time_s;
      const std::vector<double>& v = fed.values;
      const bool joints = fed.kind == io::JournalState::Kind::kJoints;
      if (joints ? v.empty() : v.size() != 7)
        throw io::InputError(journal, "holds a state that is neither a pose nor joints");
      if (joints)
        state.joints = v;
      else
        state.pose = {{v[0], v[1], v[2]}, Eigen::Quaterniond(v[6], v[3], v[4], v[5])};
    }
    const BatchResult result = update(states);
    if (!result.ok())
      differs(journal, before + result.bad + 1, batch[result.bad].time_s,
              "can't be made any more: " + result.why);
    const State& s = *state_;
    for (std::size_t i = 0; i < batch.size(); ++i) {
      if (s.samples(result.updates[i].cut_m3) != batch[i].cut_samples)
        differs(journal, before + i + 1, batch[i].time_s, "cuts something else now");
      if (s.mass(result.updates[i].bucket_m3) != batch[i].bucket_samples)
        differs(journal, before + i + 1, batch[i].time_s, "leaves another load now");
    }
    batch.clear();
    if (progress) progress(at);
  };
  while (std::optional<io::JournalRecord> record = reader.next()) {
    auto* fed = std::get_if<io::JournalState>(&*record);
    if (fed == nullptr) continue;  // a file
    if (at.updates == to) break;
    at.add(*fed);
    if (fed->kind == io::JournalState::Kind::kClock) schedule.begin_again();
    if (std::isfinite(fed->time_s)) schedule.due(fed->time_s);
    if (at.updates <= from) continue;
    const double time_s = fed->time_s;
    switch (fed->kind) {
      case io::JournalState::Kind::kPose:
      case io::JournalState::Kind::kJoints:
        batch.push_back(std::move(*fed));
        if (batch.size() == kRecordBatch) feed();
        break;
      case io::JournalState::Kind::kPours:
      case io::JournalState::Kind::kRest:
      case io::JournalState::Kind::kClock: {
        --at.updates;
        feed();
        ++at.updates;
        const StepResult result = fed->kind == io::JournalState::Kind::kPours ? pour(time_s)
                                  : fed->kind == io::JournalState::Kind::kRest
                                      ? come_to_rest()
                                      : reset_clock(fed->machine);
        if (!result.ok()) differs(journal, at.updates, time_s, "can't be made: " + result.why);
        break;
      }
    }
  }
  feed();
}

const Recording& Session::recording() const { return state_->recording; }

io::JournalExtent Session::record(const Recording& given,
                                  const std::function<void(const io::JournalExtent&)>& progress) {
  State& s = *state_;
  Recording recording = given;
  if (!s.broken.empty()) throw std::runtime_error(s.broken);
  if (s.recorder) throw std::invalid_argument("the session is recorded already");
  if (s.fed_count > 0)
    throw std::invalid_argument("a recording begins before the first state; this session has some");
  const auto is_time = [](double time_s) { return time_s >= 0 && std::isfinite(time_s); };
  if (!is_time(recording.sync_s))
    throw std::invalid_argument("a recording is synced so many seconds after, 0 or more");
  if (recording.snapshot_every_s &&
      !(is_time(*recording.snapshot_every_s) && *recording.snapshot_every_s > 0))
    throw std::invalid_argument("snapshots come so many seconds after each other, more than 0");
  if (recording.keep && *recording.keep < 2)
    throw std::invalid_argument("two snapshots stay or more: the newest may be damaged");
  // Wherever the program goes meanwhile, it is this folder.
  if (!recording.folder.empty()) recording.folder = fs::absolute(recording.folder);
  const fs::path journal = recording.folder / kJournalName;
  const Json site = s.description(/*ground=*/true);
  auto folder = std::make_unique<tools::RunFolder>(recording.folder);
  folder->make();
  try {
    folder->lock();
    // All happens to a copy, which replaces this once nothing can go wrong any more.
    Session next(std::make_unique<State>(s));
    State& n = *next.state_;
    n.recording = recording;
    n.memory_bytes = s.memory_bytes;
    n.cold_folder = s.cold_folder;
    n.limit_memory();
    tools::SnapshotSchedule schedule(recording.snapshot_every_s);
    if (!fs::exists(journal)) {
      folder->replace(tools::is_periodic);
      Json all = {{"session", kRecordFormat}, {"version", SOILVDB_VERSION}, {"site", site}};
      if (!s.scenario.empty()) all["scenario"] = s.scenario.string();
      const std::uint64_t size = io::begin_journal(journal, {io::to_cbor(all)});
      if (recording.incremental) n.unsaved.emplace();
      n.recorder = std::make_unique<tools::Recorder>(std::move(folder), recording, size,
                                                     io::JournalExtent{}, schedule);
      *this = std::move(next);
      return {};
    }
    const io::JournalContent content = io::read_journal(journal);
    require_same_site(content.config.text, site, recording.folder);
    if (content.damaged)
      throw io::InputError(
          journal,
          fmt::format("is damaged at byte {}, good to {} s; nobody can feed again what came after: "
                      "restore the file, name another folder, or give that up by `truncate -s {}` "
                      "of it",
                      content.good_bytes, tools::time_text(content.done.time_s),
                      content.good_bytes));
    folder->clear();
    const State::Found start = n.find_start(recording.folder, content);
    if (recording.incremental) n.unsaved.emplace();
    next.replay(journal, start.updates, content.done.updates, schedule, progress);
    n.fed_count = content.done.updates;
    n.recorder = std::make_unique<tools::Recorder>(std::move(folder), recording, content.good_bytes,
                                                   content.done, schedule);
    n.recorder->go_on(start.files, start.parent, content.removed);
    *this = std::move(next);
    return content.done;
  } catch (...) {
    if (folder) folder->unmake();
    throw;
  }
}

Session Session::recorded(const fs::path& folder, double time_s) const {
  const State& s = *state_;
  if (s.fed_count > 0)
    throw std::invalid_argument("a recording is gone along from before the first state");
  const fs::path journal = folder / kJournalName;
  io::JournalContent content = io::read_journal(journal);
  require_same_site(content.config.text, s.description(/*ground=*/true), folder);
  const std::uint64_t until = io::updates_until(journal, time_s);
  std::erase_if(content.files, [&](const io::JournalFile& file) { return file.updates > until; });
  Session there(std::make_unique<State>(s));
  const State::Found start = there.state_->find_start(folder, content);
  tools::SnapshotSchedule none({});
  there.replay(journal, start.updates, until, none, {});
  return there;
}

io::JournalExtent Session::acknowledged() const {
  return state_->recorder ? state_->recorder->acknowledged() : io::JournalExtent{};
}

void Session::flush() {
  if (state_->recorder) state_->recorder->flush();
}

void Session::stop_recording() {
  const std::unique_ptr<tools::Recorder> recorder = std::move(state_->recorder);
  state_->unsaved.reset();
  if (recorder) recorder->flush();
}

void Session::limit_memory(std::uint64_t bytes, const fs::path& folder) {
  if (bytes == 0) throw std::invalid_argument("the memory must be limited to more than 0 bytes");
  // Others are made there by and by, wherever the program goes meanwhile.
  const fs::path place = folder.empty() ? folder : fs::absolute(folder);
  state_->site.soil->limit_memory(bytes, std::make_shared<io::ColdFile>(place));
  state_->memory_bytes = bytes;
  state_->cold_folder = place;
}

void Session::State::limit_memory() {
  if (memory_bytes == 0) return;
  site.soil->limit_memory(memory_bytes, std::make_shared<io::ColdFile>(cold_folder));
}

}  // namespace soilvdb::inline v0
