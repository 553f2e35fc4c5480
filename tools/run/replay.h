// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How a site is brought to where a recording was: from its newest snapshot, along its journal.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tools/run/site_state.h"

namespace soilvdb::tools {

/// Where a recording is gone on with.
struct ResumePoint {
  std::unique_ptr<SiteState> state;
  std::uint64_t updates = 0;  ///< that the state has seen
  std::string snapshot = {};  ///< its name; empty: the ground before the first update
  std::optional<io::SnapshotParent> parent = {};  ///< what the snapshot goes on from
};

/// Reads the newest of some snapshots that can be gone on from.
/// @param files by updates; those that are damaged are left out
/// @param fits may a state that has seen so many updates be gone on from?
/// @param refused is told why a snapshot can't be read; the one before it is tried then
/// @return nothing if there is no such snapshot
std::optional<ResumePoint> newest_snapshot(
    const std::filesystem::path& folder, std::span<const io::JournalFile> files,
    const SiteModel& model, const std::function<bool(const SiteState&, std::uint64_t)>& fits,
    const std::function<void(const std::string&)>& refused);

/// Goes along a journal up to its update number `end`, and makes again what the site hasn't seen.
/// @param seen updates that the site has seen
/// @param ends_batch must what was made be looked at after this update?
/// @param made is handed each batch of updates, those that the site had seen as well
/// @throw std::runtime_error if an update doesn't come out as it did
void replay(const std::filesystem::path& journal, std::uint64_t seen, std::uint64_t end,
            SiteState& site, const std::function<bool(const io::JournalUpdate&)>& ends_batch,
            const std::function<void(std::span<const io::JournalUpdate>)>& made);

}  // namespace soilvdb::tools
