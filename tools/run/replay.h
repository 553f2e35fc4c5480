// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Brings a site to the end of a recording: from its newest snapshot, along its journal.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tools/run/site_state.h"

namespace soilvdb::tools {

/// The state from which a recording is continued.
struct ResumePoint {
  std::unique_ptr<SiteState> state;
  std::uint64_t updates = 0;  ///< that the state contains
  std::string snapshot = {};  ///< its name; empty: the ground before the first update
  std::optional<io::SnapshotParent> parent = {};  ///< the snapshot's own parent
};

/// Reads the newest of some snapshots that can be continued.
/// @param files by updates, without damaged ones
/// @param fits is a state with that number of updates a starting point?
/// @param refused receives the reason why a snapshot can't be read; then the one before is tried
/// @return empty if there is no such snapshot
std::optional<ResumePoint> newest_snapshot(
    const std::filesystem::path& folder, std::span<const io::JournalFile> files,
    const SiteModel& model, const std::function<bool(const SiteState&, std::uint64_t)>& fits,
    const std::function<void(const std::string&)>& refused);

/// Repeats a journal's updates up to number `end` that the site does not contain.
/// @param seen number of updates that the site contains
/// @param ends_batch must a batch end after this update?
/// @param made receives each batch of updates, also those that the site contained
/// @throw std::runtime_error if an update gives another result
void replay(const std::filesystem::path& journal, std::uint64_t seen, std::uint64_t end,
            SiteState& site, const std::function<bool(const io::JournalUpdate&)>& ends_batch,
            const std::function<void(std::span<const io::JournalUpdate>)>& made);

}  // namespace soilvdb::tools
