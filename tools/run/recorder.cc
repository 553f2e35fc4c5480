// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/recorder.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>
#include <utility>

#include "tools/run/text.h"

namespace soilvdb::tools {

Recorder::Recorder(std::unique_ptr<RunFolder> folder, const Recording& recording,
                   std::uint64_t journal_bytes, io::JournalExtent done, SnapshotSchedule schedule)
    : folder_(std::move(folder)),
      recording_(recording),
      journal_(folder_->path() / kJournalName, journal_bytes, done, recording.sync_s),
      schedule_(schedule),
      updates_(done.updates),
      snapshots_(*folder_, {recording.incremental, recording.keep, true}) {}

void Recorder::go_on(std::vector<io::JournalFile> files,
                     const std::optional<io::SnapshotParent>& parent,
                     const std::vector<std::string>& removed) {
  for (const io::JournalFile& file : files) names_.insert(file.name);
  snapshots_.go_on(std::move(files), parent);
  folder_->remove(removed);
  snapshots_.delete_old(journal_);
}

void Recorder::failed(const char* why) noexcept {
  try {
    error_ = fmt::format("{}; {} is good to {} s; stop recording or mend that and open it again",
                         why, folder_->path().string(), time_text(acknowledged().time_s));
  } catch (...) {
    error_ = "no memory";  // short enough to need none
  }
}

void Recorder::check() {
  if (error_.empty()) {
    try {
      journal_.check();
      snapshots_.check();
    } catch (const std::exception& e) {
      failed(e.what());
    }
  }
  if (!error_.empty()) throw std::runtime_error(error_);
}

bool Recorder::add(const io::JournalUpdate& update) noexcept {
  try {
    journal_.add(update);
    ++updates_;
  } catch (const std::exception& e) {
    failed(e.what());
  }
  return error_.empty();
}

bool Recorder::wants_snapshot(double time_s) {
  if (!error_.empty() || !std::isfinite(time_s)) return false;
  if (schedule_.would_be_due(time_s) && snapshots_.is_busy()) return false;  // a later one takes it
  return schedule_.due(time_s);
}

void Recorder::write_snapshot(const std::vector<Coord3>& changed, const io::Site& site,
                              io::SnapshotInfo info) noexcept {
  try {
    std::string time = time_text(info.time_s);
    constexpr std::size_t kLongest = 32;  // names of files end somewhere, too
    if (time.size() > kLongest) time = fmt::format("{}", info.time_s);
    // Times may differ by less than such a name tells, or come again when a clock was set.
    io::JournalFile file{fmt::format("soil_{}.vdb", time), updates_};
    if (!names_.insert(file.name).second) file.name = fmt::format("soil_{}_{}.vdb", time, updates_);
    snapshots_.write(file, false, changed, site, std::move(info), journal_);
  } catch (const std::exception& e) {
    failed(e.what());
  }
}

void Recorder::flush() {
  check();
  try {
    snapshots_.finish();
    journal_.flush();
  } catch (const std::exception& e) {
    failed(e.what());
    throw std::runtime_error(error_);
  }
}

}  // namespace soilvdb::tools
