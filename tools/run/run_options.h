// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a run is asked for, and that it is to stop.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <optional>

namespace soilvdb::tools {

/// Set by SIGINT and SIGTERM: finish the update, save and stop.
extern std::atomic<bool> stop_requested;

struct RunOptions {
  std::filesystem::path scenario;
  std::optional<std::filesystem::path> out;  ///< default: out/<scenario name>
  std::optional<double> voxel_size_m;        ///< instead of the scenario's
  int threads = 0;                           ///< 0: one per core
  std::optional<std::int64_t> updates;       ///< of each machine; default: one per row
  std::optional<std::int64_t> memory_mb;     ///< for the ground; default: what it takes
  bool mesh = true;
  bool snapshots = true;
};

}  // namespace soilvdb::tools
