// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The periodic snapshots of a run: their content, their writing beside updates, their deletion.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "soilvdb/background.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/site.h"
#include "soilvdb/io/snapshot.h"
#include "tools/run/run_folder.h"

namespace soilvdb::tools {

/// Writes one snapshot at a time, from a copy of its chunks. Updates pay for the copy, and wait
/// only if the last snapshot is not safe yet.
///
/// An incremental snapshot holds the changes since the last one. The next is whole when the
/// incremental ones hold as many chunks as the ground, which limits the output to twice the
/// changes, or when the chain has io::kMaxChainLength.
///
/// Only the newest `keep`, and those that they continue, stay. The others are deleted when the
/// journal on disk has the newest and the removals. If the only whole snapshot is lost, the journal
/// is dug again from its start, to the same files. The same run makes the same files, interrupted
/// or not. Not thread-safe.
class SnapshotWriter {
 public:
  struct Options {
    bool incremental = false;
    std::optional<std::size_t> keep;  ///< empty: all
    bool beside = true;               ///< in a thread of its own, else within write()
  };

  /// @param journal receives a record of each safe snapshot; it and `folder` must outlive the
  ///        writer
  SnapshotWriter(RunFolder& folder, io::JournalWriter& journal, const Options& options);

  /// Continues a run.
  /// @param files its snapshots up to the ground's state. If they are incremental, the last must be
  ///        the one that the ground was read from.
  /// @param parent of that snapshot, as read
  void go_on(std::vector<io::JournalFile> files, const std::optional<io::SnapshotParent>& parent);

  /// Copies the ground and writes the copy.
  /// @param file name and updates; all of it if the file is `there` already, intact
  /// @param changed chunks since the last snapshot; for incremental ones
  /// @param info without `parent`
  /// @throw std::runtime_error also for the last snapshot.
  void write(io::JournalFile file, bool there, const std::vector<Coord3>& changed,
             const io::Site& site, io::SnapshotInfo info);

  /// After a failure: the next snapshot is whole.
  void begin_again() { depth_ = io::kMaxChainLength; }
  /// Deletes snapshots that need not stay.
  void delete_old();

  /// Would write() wait for the last snapshot?
  bool is_busy() const { return background_ && !background_->done(); }
  /// Throws if writing has failed; does not wait.
  void check();
  /// Waits until the last snapshot is safe.
  void finish();

 private:
  void save(io::JournalFile file, const io::Site& site, const Ground* surroundings,
            const io::SnapshotInfo& info);

  RunFolder& folder_;
  io::JournalWriter& journal_;
  const Options options_;
  std::vector<io::JournalFile> files_;       // that stay
  std::size_t depth_ = 0, chunks_ = 0;       // of the last snapshot, as in io::SnapshotParent
  bool anew_ = false;                        // rewritten since the last whole one
  std::vector<std::string> done_, deleted_;  // for the folder's list of files
  std::optional<Background> background_;     // uses all members but the options
};

}  // namespace soilvdb::tools
