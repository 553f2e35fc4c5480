// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The snapshots on a run's way: what each of them holds, written beside the updates, and which of
// them stay.
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

/// Writes one snapshot at a time, from a copy of the chunks it holds: updates pay for the copy, and
/// wait only if the one before isn't safe yet.
///
/// Incremental ones hold what changed since the one before. The next is whole when they have come
/// to as many chunks as the ground has, so all that is written is at most twice what changed, or
/// to io::kMaxChainLength.
///
/// Only the newest `keep`, and what those go on from, stay: the others are deleted once the newest
/// and their going are in the journal on disk. Incremental ones may all go on from the same whole
/// one: without that the journal is dug again from its start, to the same files. The same run makes
/// the same files, interrupted or not. For one thread.
class SnapshotWriter {
 public:
  struct Options {
    bool incremental = false;
    std::optional<std::size_t> keep;  ///< all
    bool beside = true;               ///< on a thread of its own, else within write()
  };

  /// @param journal gets a record of each snapshot once it is safe; both outlive the writer
  SnapshotWriter(RunFolder& folder, io::JournalWriter& journal, const Options& options);

  /// Goes on with a run.
  /// @param files its snapshots up to where the ground is; if they are incremental the last is the
  ///        one that it was read from, and what changed is since that
  /// @param parent what reading that one gave
  void go_on(std::vector<io::JournalFile> files, const std::optional<io::SnapshotParent>& parent);

  /// Takes a copy of the ground and writes that.
  /// @param file its name and updates; if it is `there` already, intact, then all of it
  /// @param changed chunks since the one before; for incremental ones
  /// @param info all but `parent`
  /// @throw std::runtime_error for the one before this, too.
  void write(io::JournalFile file, bool there, const std::vector<Coord3>& changed,
             const io::Site& site, io::SnapshotInfo info);

  /// Deletes what need not stay.
  void delete_old();

  /// Would write() wait for the one before?
  bool is_busy() const { return background_ && !background_->done(); }
  /// Throws if writing has failed; doesn't wait.
  void check();
  /// Waits until the last one is safe.
  void finish();

 private:
  void save(io::JournalFile file, const io::Site& site, const Ground* surroundings,
            const io::SnapshotInfo& info);

  RunFolder& folder_;
  io::JournalWriter& journal_;
  const Options options_;
  std::vector<io::JournalFile> files_;       // that stay
  std::size_t depth_ = 0, chunks_ = 0;       // as io::SnapshotParent has them, of the last one
  bool anew_ = false;                        // one was written since the last whole one
  std::vector<std::string> done_, deleted_;  // that the folder isn't told of yet
  std::optional<Background> background_;     // works on all but the options
};

}  // namespace soilvdb::tools
