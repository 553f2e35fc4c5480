// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A recording that was made anew without some states. Private to the session's files.
#pragma once

#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "tools/run/session_state.h"
#include "tools/run/snapshot_schedule.h"

namespace soilvdb::inline v0 {

struct Undone {
  Undone(Session begin, std::filesystem::path file, std::optional<double> snapshot_every_s)
      : site(std::move(begin)), journal(std::move(file)), schedule(snapshot_every_s) {}
  ~Undone();
  Undone(const Undone&) = delete;
  Undone& operator=(const Undone&) = delete;

  Session site;                   ///< at its end
  std::filesystem::path journal;  ///< removed at the end, unless it has become the recording's
  tools::SnapshotSchedule schedule;
  io::JournalContent content = {};
  std::vector<io::JournalFile> snapshots = {};  ///< intact, by updates
};

}  // namespace soilvdb::inline v0
