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
/// Updates that are made again at once.
constexpr std::size_t kReplayBatch = 256;

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

}  // namespace

/// The newest good ground of a recording, and what leads there.
struct Session::State::Found {
  std::uint64_t updates = 0;
  std::vector<io::JournalFile> files = {};
  std::optional<io::SnapshotParent> parent = {};
};

/// Goes on to the newest snapshot that is good, if there is one.
/// @param files snapshots, by updates
/// @param whole may it be of soil at rest, as at a run's end?
Session::State::Found Session::State::find_start(const fs::path& folder,
                                                 std::vector<io::JournalFile> files, bool whole) {
  for (; !files.empty(); files.pop_back()) {
    const io::JournalFile& file = files.back();
    if (file.updates == 0 || !tools::fault_of(folder / file.name, file).empty()) continue;
    try {
      io::SnapshotInfo info;
      SiteState there(machines, earthmoving, io::read_snapshot(folder / file.name, &info));
      there.set_progress(info.tracker_state);
      if (there.at_rest && !whole) continue;
      become(std::move(there));
      const std::uint64_t updates = file.updates;
      return {updates, std::move(files), info.parent};
    } catch (const io::InputError&) {
    } catch (const std::invalid_argument&) {
    }  // the journal holds what it held, too
  }
  return {};
}

/// Does what a journal holds beyond a snapshot, up to so many updates.
void Session::State::replay(const fs::path& journal, std::uint64_t from, std::uint64_t to,
                            tools::SnapshotSchedule& schedule,
                            const std::function<void(const io::JournalExtent&)>& progress) {
  io::JournalReader reader(journal);
  io::JournalExtent at;
  std::vector<io::JournalUpdate> batch;
  std::uint64_t before = 0;  // updates before the batch
  const auto make = [&] {
    try {
      redo(batch);
    } catch (const tools::UpdateDiffers& e) {
      const auto bad = batch.begin() + static_cast<std::ptrdiff_t>(e.index);
      before += static_cast<std::uint64_t>(std::count_if(
          batch.begin(), bad, [](const io::JournalUpdate& made) { return made.ends_update; }));
      throw tools::differs(journal, before + 1, bad->end_s, e);
    }
    if (!batch.empty() && progress) progress(at);
    batch.clear();
    before = at.updates;
  };
  while (std::optional<io::JournalRecord> record = reader.next()) {
    auto* update = std::get_if<io::JournalUpdate>(&*record);
    if (update == nullptr) continue;  // a file
    if (at.updates == to) break;
    const bool known = at.updates < from;
    at.add(*update);
    if (update->kind == io::JournalUpdate::Kind::kClock) schedule.begin_again();
    if (std::isfinite(update->end_s) && update->kind != io::JournalUpdate::Kind::kRest)
      schedule.due(update->end_s);
    if (known) {
      if (update->machine < machines.size()) follow(*update);
      before = at.updates;
      continue;
    }
    batch.push_back(std::move(*update));
    if (batch.size() == kReplayBatch) make();
  }
  make();
}

const Recording& Session::recording() const { return state_->settings.recording; }

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
    n.settings.recording = recording;
    n.limit_memory();
    tools::SnapshotSchedule schedule(recording.snapshot_every_s);
    if (!fs::exists(journal)) {
      folder->replace(tools::is_periodic);
      Json all = {{"session", kRecordFormat}, {"version", SOILVDB_VERSION}, {"site", site}};
      if (!s.settings.scenario.empty()) all["scenario"] = s.settings.scenario.string();
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
    std::vector<io::JournalFile> good;
    for (const tools::RunFile& file : tools::check_files(recording.folder, content))
      if (file.fault.empty() && tools::is_periodic(file.known.name)) good.push_back(file.known);
    const State::Found start = n.find_start(recording.folder, std::move(good), false);
    if (recording.incremental) n.unsaved.emplace();
    n.replay(journal, start.updates, content.done.updates, schedule, progress);
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
  if (tools::is_of_session(content.config.text))
    require_same_site(content.config.text, s.description(/*ground=*/true), folder);
  else
    tools::parse_run_config(content.config.text, folder);  // its inputs are as they were
  const std::uint64_t until = io::updates_until(journal, time_s);
  const bool whole = content.ended && until == content.done.updates;
  std::erase_if(content.files, [&](const io::JournalFile& file) {
    return file.updates > until ||
           !(tools::is_periodic(file.name) || file.name == tools::kFinalName);
  });
  Session there(std::make_unique<State>(s));
  State& t = *there.state_;
  const State::Found start = t.find_start(folder, std::move(content.files), whole);
  tools::SnapshotSchedule none({});
  t.replay(journal, start.updates, until, none, {});
  if (whole && t.earthmoving.soil && !t.at_rest) t.tracker->come_to_rest(content.done.time_s);
  t.fed_count = until;
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
  state_->settings.memory_bytes = bytes;
  state_->settings.cold_folder = place;
}

void Session::State::limit_memory() {
  const std::uint64_t bytes = settings.memory_bytes;
  if (bytes > 0)
    site.soil->limit_memory(bytes, std::make_shared<io::ColdFile>(settings.cold_folder));
}

}  // namespace soilvdb::inline v0
