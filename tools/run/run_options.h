// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Options of a run, and its stop flag.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <optional>

namespace soilvdb::tools {

/// Set by SIGINT and SIGTERM: the run finishes its update, saves and stops.
extern std::atomic<bool> stop_requested;

struct RunOptions {
  std::filesystem::path scenario;
  std::optional<std::filesystem::path> out;  ///< default: out/<scenario name>
  std::optional<double> voxel_size_m;        ///< in place of the scenario's
  int threads = 0;                           ///< 0: one per core
  std::optional<std::int64_t> updates;       ///< of each machine; default: one per row
  std::optional<std::int64_t> memory_mb;     ///< for the ground; default: no limit
  bool mesh = true;
  bool snapshots = true;
};

}  // namespace soilvdb::tools
