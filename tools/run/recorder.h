// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The record of a run or a session: the journal of its updates, and periodic snapshots.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "soilvdb/change_follower.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/site.h"
#include "soilvdb/io/snapshot.h"
#include "tools/run/replay.h"
#include "tools/run/run_folder.h"
#include "tools/run/snapshot_schedule.h"
#include "tools/run/snapshot_writer.h"

namespace soilvdb::tools {

/// Records into a folder. Not thread-safe.
class Recorder {
 public:
  /// @param folder must be locked; it and `ground` must outlive the recorder
  /// @param sync_s as in io::JournalWriter
  /// @param waits_for_room a full disk stops it only until there is room
  Recorder(RunFolder& folder, Ground& ground, double sync_s,
           const SnapshotWriter::Options& snapshots, SnapshotSchedule schedule,
           bool waits_for_room = false);

  /// Begins a journal in place of the folder's content. @param begin_s time before the first update
  /// @throw std::runtime_error if it can't be written
  void begin(const io::JournalConfig& config, double begin_s);
  /// Continues the folder's journal and snapshots.
  /// @param good the intact snapshots, by updates
  /// @param from without a snapshot, the next one is whole
  /// @throw std::runtime_error if it can't be written
  void go_on(const io::JournalContent& journal, std::span<const io::JournalFile> good,
             const ResumePoint& from);
  bool has_begun() const { return journal_.has_value(); }

  /// Counts an update that is already in the journal, for the times of snapshots.
  void note(const io::JournalUpdate& update);
  /// Counts updates of the journal that are not noted.
  void skip(std::uint64_t updates) { updates_ += updates; }
  /// @return false if recording has failed; error() has the reason
  bool add(const io::JournalUpdate& update) noexcept;
  /// Throws if recording has failed; it then records no more, except after io::DiskFull.
  void check();
  const std::string& error() const { return error_; }
  /// Is the error a full disk, after which it records again?
  bool waits() const { return full_; }

  bool would_be_due(double time_s) const { return schedule_.would_be_due(time_s); }
  /// Is a snapshot due at a time?
  bool due(double time_s) { return schedule_.due(time_s); }
  /// Would a snapshot wait for the last one?
  bool is_busy() const { return snapshots_->is_busy(); }
  /// Writes a snapshot of the present ground, unless an intact one exists.
  void write_snapshot(const io::Site& site, io::SnapshotInfo info) noexcept;

  /// Returns when all added records and snapshots are safe on disk.
  void flush();
  /// As flush() after an error, as far as possible.
  void save_what_can_be() noexcept;
  io::JournalExtent acknowledged() const;
  io::JournalWriter& journal() { return *journal_; }

 private:
  /// Calls f(), in which a snapshot may fail that the disk has no room for: the next one is whole.
  template <typename F>
  void with_snapshots(const F& f);
  void open(std::uint64_t bytes, const io::JournalExtent& done);
  std::string name_of_next(double time_s);

  RunFolder& folder_;
  const double sync_s_;
  const bool waits_for_room_;
  const SnapshotWriter::Options options_;
  SnapshotSchedule schedule_;
  std::optional<ChangeFollower> changes_;  // since the last snapshot, if snapshots are incremental
  std::optional<io::JournalWriter> journal_;  // from begin() or go_on() on
  std::optional<SnapshotWriter> snapshots_;   // writes to the journal
  std::uint64_t updates_ = 0;                 // added or noted
  std::set<std::string> names_;               // of snapshots, each of which is written once
  std::vector<io::JournalFile> later_;        // intact snapshots of future updates
  std::string error_;
  bool full_ = false;  // the error may pass
};

}  // namespace soilvdb::tools
