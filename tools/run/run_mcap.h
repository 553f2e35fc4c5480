// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a run records as MCAP: which blocks it meshes, and when.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "tools/run/ground_mcap.h"
#include "tools/run/snapshot_schedule.h"

namespace soilvdb::tools {

/// Records a run into FILE.part, which close() renames to FILE. Without close() nothing is left,
/// and a FILE that was there before stays. It hangs on the times of updates only, so a run has the
/// same bytes for any number of threads, and dug again. For one thread.
class RunMcap {
 public:
  /// @param site outlives it; what it holds already is recorded as the run begins
  /// @throw std::runtime_error naming the file and the cause, as the others do.
  RunMcap(std::filesystem::path file, const io::Scenario& scenario, const io::Site& site,
          double begin_s, double end_s);
  ~RunMcap();
  RunMcap(const RunMcap&) = delete;
  RunMcap& operator=(const RunMcap&) = delete;

  /// Would the ground be recorded at a time when all machines are there?
  bool would_be_due(double time_s) const { return schedule_.would_be_due(time_s); }
  bool due(double time_s) { return schedule_.due(time_s); }

  /// @param changed chunks since the last time
  void ground(double time_s, std::span<const Coord3> changed);
  void load(double time_s, std::size_t machine, const SoilMcap::Load& load) {
    mcap_.load(time_s, machine, load);
  }
  /// @param changed as ground() has them
  void close(double time_s, std::span<const Coord3> changed);

 private:
  std::filesystem::path file_, part_;
  SnapshotSchedule schedule_, elevation_schedule_;
  GroundMcap mcap_;
  bool closed_ = false;
};

}  // namespace soilvdb::tools
