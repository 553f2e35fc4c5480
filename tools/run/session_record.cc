// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Recording of a session to a folder, and its continuation.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "io/file/atomic_file.h"
#include "io/file/json.h"
#include "io/snapshot/swap_file.h"
#include "soilvdb/io/error.h"
#include "soilvdb/version.h"
#include "tools/run/recording_change.h"
#include "tools/run/run_config.h"
#include "tools/run/run_files.h"
#include "tools/run/session_state.h"
#include "tools/run/text.h"

namespace soilvdb::inline v0 {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using tools::kJournalName;

bool ends_no_batch(const io::JournalUpdate&) { return false; }

/// The configuration of a session's journal that is made for this site: the same, or a changed one
/// if other machines or hoppers came since. @throw io::InputError
Json config_of(const io::JournalContent& journal, const Json& site,
               std::optional<tools::MachineChange>& change) {
  Json config = io::from_cbor(journal.config.text);
  change = tools::change_of_machines(config["site"], site, journal.done.time_s);
  return config;
}

/// @throw io::InputError unless a journal is a session's, in the present format
void require_session(const std::string& config, const fs::path& folder) {
  if (!tools::is_of_session(config))
    throw io::InputError(folder,
                         "holds a run of `soilvdb run`, which `soilvdb resume` goes on with; name "
                         "another folder");
  tools::check_record_format(config, folder);
}

/// @throw io::InputError unless a session's journal is of this site
void require_same_site(const std::string& config, const Json& site, const fs::path& folder) {
  if (const std::string what = difference(io::from_cbor(config)["site"], site); !what.empty())
    throw io::InputError(
        folder,
        fmt::format("is a recording of another site: {} differs; name another folder", what));
}

}  // namespace

/// Restores the newest good snapshot, if there is one.
/// @param snapshots intact, by updates
/// @param may_rest may it hold soil at rest, as at a run's end?
tools::ResumePoint Session::State::find_start(const fs::path& recording,
                                              std::span<const io::JournalFile> snapshots,
                                              bool may_rest) {
  const auto fits = [&](const SiteState& there, std::uint64_t) {
    return may_rest || !there.rests_at_end();
  };
  std::optional<tools::ResumePoint> start =
      tools::newest_snapshot(recording, snapshots, model(), fits,
                             [](const std::string&) {});  // the journal also has its content
  if (!start) return {};
  become(std::move(*start->state));
  return std::move(*start);
}

const Recording& Session::recording() const { return state_->settings.recording; }

io::JournalExtent Session::record(const Recording& given,
                                  const std::function<void(const io::JournalExtent&)>& progress) {
  State& s = *state_;
  Recording recording = given;
  if (!s.broken_.empty()) throw std::runtime_error(s.broken_);
  if (s.recorder) throw std::invalid_argument("the session is recorded already");
  if (s.fed_count > 0)
    throw std::invalid_argument("a recording begins before the first state; this session has some");
  const auto* raster = std::get_if<io::RasterTerrain>(&s.site.reference.terrain);
  if (raster != nullptr && raster->heights)
    throw std::invalid_argument(
        "a recording names its terrain's file, but this terrain is an array; write it to a GeoTIFF "
        "and make the site of that");
  const auto is_time = [](double time_s) { return time_s >= 0 && std::isfinite(time_s); };
  if (!is_time(recording.sync_s))
    throw std::invalid_argument("the time until a recording is synced must be 0 s or more");
  if (recording.snapshot_every_s &&
      !(is_time(*recording.snapshot_every_s) && *recording.snapshot_every_s > 0))
    throw std::invalid_argument("the time between snapshots must be more than 0 s");
  if (recording.keep && *recording.keep < 2)
    throw std::invalid_argument(
        "at least two snapshots must stay, because the newest may be damaged");
  // Absolute, because the working directory may change.
  if (!recording.folder.empty()) recording.folder = fs::absolute(recording.folder);
  const fs::path journal = recording.folder / kJournalName;
  auto folder = std::make_unique<tools::RunFolder>(recording.folder);
  folder->make();
  try {
    folder->lock();
    // Works on a copy, which replaces this session when nothing can fail any more.
    Session next(std::make_unique<State>(s));
    State& n = *next.state_;
    n.settings.recording = recording;
    n.set_memory_limit(*n.site.ground);
    const auto open_recorder = [&] {
      n.recorder = n.new_recorder(*folder, tools::SnapshotSchedule(recording.snapshot_every_s));
    };
    const auto become_next = [&] {
      n.folder = std::move(folder);
      *this = std::move(next);
    };
    if (!fs::exists(journal)) {
      folder->replace(tools::is_periodic);
      Json all = {{"session", tools::kRecordFormat},
                  {"version", SOILVDB_VERSION},
                  {"site", s.description(/*with_ground=*/true)}};
      if (!s.settings.scenario.empty()) all["scenario"] = s.settings.scenario.string();
      if (!s.settings.changes.empty()) all["changes"] = s.settings.changes;
      n.journal_config = io::to_cbor(all);
      open_recorder();
      n.recorder->begin({n.journal_config}, /*begin_s=*/0);
      become_next();
      return {};
    }
    io::JournalContent content = io::read_journal(journal);
    std::optional<tools::MachineChange> change;
    require_session(content.config.text, recording.folder);
    n.repeat_changes(io::from_cbor(content.config.text), recording.folder);
    const Json site = n.description(/*with_ground=*/true);
    n.journal_config = io::to_cbor(config_of(content, site, change));
    require_same_site(n.journal_config, site, recording.folder);
    if (content.damaged)
      throw io::InputError(
          journal,
          fmt::format(
              "is damaged at byte {}, good to {} s; states after that can't be fed again: restore "
              "the file, name another folder, or give them up by `truncate -s {}` of it",
              content.good_bytes, tools::time_text(content.done.time_s), content.good_bytes));
    folder->clear();
    // A copy for the changed site takes the journal's place when nothing can fail any more.
    const fs::path changed = recording.folder / fmt::format(".journal.{}-0.tmp", getpid());
    if (change) {
      tools::copy_journal(journal, changed, n.journal_config, *change);
      content = io::read_journal(changed);
    }
    const auto drop_copy = [&](const fs::path* file) {
      std::error_code none;
      if (change) fs::remove(*file, none);
    };
    const std::unique_ptr<const fs::path, decltype(drop_copy)> unused(&changed, drop_copy);
    const std::vector<io::JournalFile> good = tools::good_snapshots(recording.folder, content);
    const tools::ResumePoint start = n.find_start(recording.folder, good, /*may_rest=*/false);
    open_recorder();
    io::JournalExtent at;
    const auto made = [&](std::span<const io::JournalUpdate> updates) {
      for (const io::JournalUpdate& update : updates) {
        at.add(update);
        n.recorder->note(update);
        if (std::isfinite(update.end_s) && update.kind != io::JournalUpdate::Kind::kRest)
          n.recorder->due(update.end_s);
      }
      if (progress && at.updates > start.updates) progress(at);
    };
    tools::replay(change ? changed : journal, start.updates, content.done.updates, n, ends_no_batch,
                  made);
    if (change) {
      fs::rename(changed, journal);
      io::sync_folder(journal);
    }
    n.recorder->go_on(content, good, start);  // from here on the folder changes
    n.fed_count = content.done.updates;
    become_next();
    return content.done;
  } catch (...) {
    folder->unmake();
    throw;
  }
}

std::unique_ptr<tools::Recorder> Session::State::new_recorder(
    tools::RunFolder& to, tools::SnapshotSchedule schedule) const {
  const Recording& recording = settings.recording;
  return std::make_unique<tools::Recorder>(
      to, *site.ground, recording.sync_s,
      tools::SnapshotWriter::Options{recording.incremental, recording.keep, true},
      std::move(schedule), recording.waits_for_room);
}

Session Session::recorded(const fs::path& folder, double time_s) const {
  return at_update(folder, io::updates_until(folder / kJournalName, time_s));
}

Session Session::at_update(const fs::path& folder, std::uint64_t until) const {
  const State& s = *state_;
  if (s.fed_count > 0)
    throw std::invalid_argument("a recording can be read only before the session's first state");
  const fs::path journal = folder / kJournalName;
  const io::JournalContent content = io::read_journal(journal);
  Session there(std::make_unique<State>(s));
  State& t = *there.state_;
  if (tools::is_of_session(content.config.text)) {
    require_session(content.config.text, folder);
    t.repeat_changes(io::from_cbor(content.config.text), folder);
    require_same_site(content.config.text, t.description(/*with_ground=*/true), folder);
  } else {
    tools::parse_run_config(content.config.text, folder);  // checks its inputs
  }
  const bool whole = content.ended && until == content.done.updates;
  std::vector<io::JournalFile> snapshots;
  for (const io::JournalFile& file : content.files) {
    const bool is_snapshot = tools::is_periodic(file.name) || file.name == tools::kFinalName;
    if (is_snapshot && file.updates <= until) snapshots.push_back(file);
  }
  const tools::ResumePoint start = t.find_start(folder, snapshots, whole);
  tools::replay(journal, start.updates, until, t, ends_no_batch,
                [](std::span<const io::JournalUpdate>) {});
  if (whole) t.rest_at_end(content.done.time_s);
  t.fed_count = until;
  return there;
}

std::uint64_t Session::changes() const { return state_->fed_count; }

std::string Session::recording_fault() const {
  try {
    state_->require_recording();
    return "";
  } catch (const std::exception& e) {
    return e.what();
  }
}

io::JournalExtent Session::acknowledged() const {
  return state_->recorder ? state_->recorder->acknowledged() : io::JournalExtent{};
}

std::uint64_t Session::hurry() {
  return state_->recorder ? state_->recorder->journal().hurry() : 0;
}

void Session::flush() {
  State& s = *state_;
  if (!s.recorder) return;
  try {
    s.recorder->flush();
  } catch (const std::exception& e) {
    throw std::runtime_error(s.recording_error(e.what()));
  }
}

void Session::stop_recording() {
  State& s = *state_;
  std::string error;
  try {
    flush();
  } catch (const std::exception& e) {
    error = e.what();
  }
  s.recorder.reset();
  s.folder.reset();
  if (!error.empty()) throw std::runtime_error(error);
}

void Session::set_memory_limit(std::uint64_t bytes, const fs::path& folder) {
  if (bytes == 0) throw std::invalid_argument("the memory must be limited to more than 0 bytes");
  // Absolute, because more files are made later and the working directory may change.
  const fs::path place = folder.empty() ? folder : fs::absolute(folder);
  state_->site.ground->set_memory_limit(bytes, std::make_shared<io::SwapFile>(place));
  state_->settings.memory_bytes = bytes;
  state_->settings.swap_folder = place;
}

void Session::State::set_memory_limit(Ground& ground) const {
  const std::uint64_t bytes = settings.memory_bytes;
  if (bytes > 0)
    ground.set_memory_limit(bytes, std::make_shared<io::SwapFile>(settings.swap_folder));
}

}  // namespace soilvdb::inline v0
