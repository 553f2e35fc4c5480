// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Are the files that a run wrote still as its journal knows them?
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"

namespace soilvdb::tools {

struct RunFile {
  io::JournalFile known;
  std::string fault;  ///< what is wrong with it; empty: nothing
  /// The run has gone on since it wrote this at an end that was none. It will write it again,
  /// and may have: its state says nothing about the run.
  bool outdated = false;
};

/// The files that a journal knows, by updates, read from end to end. An incremental snapshot is
/// only good with all that it goes on from.
std::vector<RunFile> check_files(const std::filesystem::path& folder,
                                 const io::JournalContent& journal);

/// What is wrong with one of them by itself; empty if nothing is.
std::string fault_of(const std::filesystem::path& file, const io::JournalFile& known);

}  // namespace soilvdb::tools
