// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a run or a session is recorded by: the journal of its updates, and snapshots on the way.
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

/// Records into a folder. For one thread.
class Recorder {
 public:
  /// @param folder is locked, and outlives the recorder; `ground` does, too
  /// @param sync_s as io::JournalWriter has it
  Recorder(RunFolder& folder, Ground& ground, double sync_s,
           const SnapshotWriter::Options& snapshots, SnapshotSchedule schedule);

  /// Begins a journal in place of what the folder held. @param begin_s before the first update
  /// @throw std::runtime_error if it can't be written
  void begin(const io::JournalConfig& config, double begin_s);
  /// Goes on with the folder's journal and snapshots.
  /// @param good its snapshots that are intact, by updates
  /// @throw std::runtime_error if it can't be written
  void go_on(const io::JournalContent& journal, std::span<const io::JournalFile> good,
             const ResumePoint& from);
  bool has_begun() const { return journal_.has_value(); }

  /// An update that the journal holds already: snapshots come due by its time.
  void note(const io::JournalUpdate& update);
  /// @return is it recorded, as far as is known? error() says why not.
  bool add(const io::JournalUpdate& update) noexcept;
  /// Throws what went wrong; then nothing is recorded any more.
  void check();
  const std::string& error() const { return error_; }

  bool would_be_due(double time_s) const { return schedule_.would_be_due(time_s); }
  /// Is a snapshot due at a time?
  bool due(double time_s) { return schedule_.due(time_s); }
  /// Would a snapshot wait for the one before it?
  bool is_busy() const { return snapshots_->is_busy(); }
  /// A snapshot of now, unless an intact one is there.
  void write_snapshot(const io::Site& site, io::SnapshotInfo info) noexcept;

  /// Returns when all that was added, snapshots as well, can't be lost any more.
  void flush();
  /// The same after an error, as far as it goes.
  void save_what_can_be() noexcept;
  io::JournalExtent acknowledged() const;
  io::JournalWriter& journal() { return *journal_; }

 private:
  void open(std::uint64_t bytes, const io::JournalExtent& done);
  std::string name_of_next(double time_s);

  RunFolder& folder_;
  const double sync_s_;
  const SnapshotWriter::Options options_;
  SnapshotSchedule schedule_;
  std::optional<ChangeFollower> changes_;     // since the last snapshot, if they are incremental
  std::optional<io::JournalWriter> journal_;  // from begin() or go_on() on
  std::optional<SnapshotWriter> snapshots_;   // writes to the journal
  std::uint64_t updates_ = 0;                 // that were added or noted
  std::set<std::string> names_;               // of snapshots: each is written once
  std::vector<io::JournalFile> later_;        // intact, of updates that are yet to come
  std::string error_;
};

}  // namespace soilvdb::tools
