// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Checks a run's files against its journal.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"

namespace soilvdb::tools {

struct RunFile {
  io::JournalFile known;
  std::string fault;  ///< empty: intact
  /// The run was continued after it wrote this file at a preliminary end. It will rewrite the file,
  /// so the file's state is no fault.
  bool outdated = false;
};

/// Checks all files in a journal, by updates, from start to end. An incremental snapshot is good
/// only with all that it continues.
std::vector<RunFile> check_files(const std::filesystem::path& folder,
                                 const io::JournalContent& journal);

/// The fault of a single file; empty if it is intact.
std::string fault_of(const std::filesystem::path& file, const io::JournalFile& known);

/// The periodic snapshots that are intact, by updates.
std::vector<io::JournalFile> good_snapshots(const std::filesystem::path& folder,
                                            const io::JournalContent& journal);

}  // namespace soilvdb::tools
