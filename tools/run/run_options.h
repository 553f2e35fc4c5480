// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a run is asked for, and that it is to stop.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace soilvdb::tools {

/// Set by SIGINT and SIGTERM: finish the update, save and stop.
extern std::atomic<bool> stop_requested;

/// Some machines of a scenario in a window of its time, dug apart from the others: those of their
/// updates that end after begin_s and no later than end_s.
struct Part {
  std::filesystem::path start;        ///< snapshot: ground and machines as the window begins
  std::vector<std::string> machines;  ///< names
  double begin_s = 0, end_s = 0;
  std::vector<double> ends_s;  ///< where all the scenario's motions end
};

struct RunOptions {
  std::filesystem::path scenario;
  std::optional<std::filesystem::path> out;  ///< default: out/<scenario name>
  std::optional<double> voxel_size_m;        ///< instead of the scenario's
  int threads = 0;                           ///< 0: one per core
  std::optional<std::int64_t> updates;       ///< of each machine; default: one per row
  std::optional<std::int64_t> memory_mb;     ///< for the ground; default: what it takes
  bool mesh = true;
  bool snapshots = true;
  bool in_parts = false;     ///< was dug in parts: no snapshots on the way
  std::optional<Part> part;  ///< only that of the scenario, and of files only what merging needs
};

}  // namespace soilvdb::tools
