// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a session is recorded by: the journal of what it was fed, and snapshots.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/site.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/session.h"
#include "tools/run/run_folder.h"
#include "tools/run/snapshot_schedule.h"
#include "tools/run/snapshot_writer.h"

namespace soilvdb::tools {

/// Records a session into its folder, which it keeps others out of. For one thread.
class Recorder {
 public:
  /// @param journal_bytes that are good of the journal in the folder
  /// @param done how far that goes
  /// @param schedule as it is by then
  /// @throw std::runtime_error if the journal can't be written
  Recorder(std::unique_ptr<RunFolder> folder, const Recording& recording,
           std::uint64_t journal_bytes, io::JournalExtent done, SnapshotSchedule schedule);

  /// @param files snapshots that lead to where the ground is, `parent` what reading the last gave
  /// @param removed files that go
  void go_on(std::vector<io::JournalFile> files, const std::optional<io::SnapshotParent>& parent,
             const std::vector<std::string>& removed);

  /// Throws what went wrong; then nothing is recorded any more.
  void check();
  /// @return is it recorded, as far as is known? error() says why not.
  bool add(const io::JournalUpdate& update) noexcept;
  /// A machine's clock was set: snapshots come due by what it says from then on.
  void begin_schedule_again() { schedule_.begin_again(); }
  /// Is one due after a state at this time? Not before the last is safe: nothing waits for that.
  bool wants_snapshot(double time_s);
  /// @param changed chunks since the last one, where they are incremental
  void write_snapshot(const std::vector<Coord3>& changed, const io::Site& site,
                      io::SnapshotInfo info) noexcept;
  /// Returns when all that was added, snapshots as well, can't be lost any more.
  void flush();
  const std::string& error() const { return error_; }
  io::JournalExtent acknowledged() const { return journal_.acknowledged(); }

 private:
  void failed(const char* why) noexcept;

  std::unique_ptr<RunFolder> folder_;
  Recording recording_;
  io::JournalWriter journal_;
  SnapshotSchedule schedule_;
  std::uint64_t updates_;
  SnapshotWriter snapshots_;          // writes to the journal, too
  std::set<std::string> names_ = {};  // of snapshots: none takes the place of another
  std::string error_;
};

}  // namespace soilvdb::tools
