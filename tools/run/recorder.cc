// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/recorder.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "soilvdb/io/error.h"
#include "tools/run/text.h"

namespace soilvdb::tools {

Recorder::Recorder(RunFolder& folder, Ground& ground, double sync_s,
                   const SnapshotWriter::Options& snapshots, SnapshotSchedule schedule,
                   bool waits_for_room)
    : folder_(folder),
      sync_s_(sync_s),
      waits_for_room_(waits_for_room),
      options_(snapshots),
      schedule_(schedule) {
  if (!options_.incremental) return;
  changes_.emplace(ground);
  changes_->take();  // the first snapshot is whole, or continues the snapshot that was read
}

void Recorder::open(std::uint64_t bytes, const io::JournalExtent& done) {
  journal_.emplace(folder_.path() / kJournalName, bytes, done, sync_s_, waits_for_room_);
  snapshots_.emplace(folder_, *journal_, options_);
}

void Recorder::begin(const io::JournalConfig& config, double begin_s) {
  open(io::begin_journal(folder_.path() / kJournalName, config, folder_.replaced()), {0, begin_s});
  folder_.remove(folder_.replaced());
}

void Recorder::go_on(const io::JournalContent& journal, std::span<const io::JournalFile> good,
                     const ResumePoint& from) {
  open(journal.good_bytes, journal.done);
  std::vector<io::JournalFile> seen;
  for (const io::JournalFile& file : good) {
    const bool before = file.updates < from.updates || file.name == from.snapshot;
    (before ? seen : later_).push_back(file);
    if (!before) continue;
    names_.insert(file.name);
    folder_.done(file.name);
  }
  snapshots_->go_on(std::move(seen), from.parent);
  if (from.snapshot.empty()) snapshots_->begin_again();
  folder_.remove(journal.removed);
  snapshots_->delete_old();
}

void Recorder::note(const io::JournalUpdate& update) {
  using Kind = io::JournalUpdate::Kind;
  updates_ += update.ends_update;
  if (update.kind == Kind::kClock) schedule_.begin_again();
}

bool Recorder::add(const io::JournalUpdate& update) noexcept {
  try {
    note(update);
    journal_->add(update);
  } catch (const io::DiskFull& e) {
    full_ = waits_for_room_;
    error_ = e.what();
  } catch (const std::exception& e) {
    if (error_.empty()) error_ = e.what();
  }
  return error_.empty();
}

void Recorder::check() {
  if (!error_.empty() && !full_) throw std::runtime_error(error_);
  if (!journal_) return;
  try {
    journal_->check();
    with_snapshots([&] { snapshots_->check(); });
    error_.clear();
    full_ = false;
  } catch (const io::DiskFull& e) {
    error_ = e.what();
    full_ = waits_for_room_;
    throw;
  } catch (const std::exception& e) {
    error_ = e.what();
    throw;
  }
}

template <typename F>
void Recorder::with_snapshots(const F& f) {
  try {
    f();
  } catch (const io::DiskFull&) {
    if (!waits_for_room_) throw;
    snapshots_->begin_again();
  }
}

/// Times can differ by less than a name shows, or repeat after a clock was set.
std::string Recorder::name_of_next(double time_s) {
  std::string time = time_text(time_s);
  constexpr std::size_t kLongest = 32;  // limit for names of files
  if (time.size() > kLongest) time = fmt::format("{}", time_s);
  std::string name = fmt::format("soil_{}.vdb", time);
  if (!names_.insert(name).second) name = fmt::format("soil_{}_{}.vdb", time, updates_);
  return name;
}

void Recorder::write_snapshot(const io::Site& site, io::SnapshotInfo info) noexcept {
  try {
    io::JournalFile file{name_of_next(info.time_s), updates_};
    const auto there = std::find_if(later_.begin(), later_.end(), [&](const auto& known) {
      return known.name == file.name && known.updates == file.updates;
    });
    if (there != later_.end()) file = *there;
    with_snapshots([&] { snapshots_->finish(); });
    const std::vector<Coord3> changed = changes_ ? changes_->take() : std::vector<Coord3>();
    snapshots_->write(std::move(file), there != later_.end(), changed, site, std::move(info));
  } catch (const std::exception& e) {
    error_ = e.what();
  }
}

void Recorder::flush() {
  if (!journal_) return;
  check();
  try {
    with_snapshots([&] { snapshots_->finish(); });
    journal_->flush();
  } catch (const std::exception& e) {
    error_ = e.what();
    full_ = waits_for_room_ && dynamic_cast<const io::DiskFull*>(&e) != nullptr;
    throw;
  }
}

void Recorder::save_what_can_be() noexcept {
  try {
    snapshots_->finish();
  } catch (const std::exception&) {  // it was reported, or is no worse
  }
  try {
    journal_->flush();
  } catch (const std::exception&) {  // the disk may be full
  }
}

io::JournalExtent Recorder::acknowledged() const {
  return journal_ ? journal_->acknowledged() : io::JournalExtent{};
}

}  // namespace soilvdb::tools
