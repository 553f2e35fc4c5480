// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soil.mcap of a live site, written beside its feeds.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "soilvdb/ground_copy.h"
#include "tools/run/soil_mcap.h"
#include "tools/serve/live_site.h"

namespace soilvdb::tools {

/// Gathers changes on the feeding thread, and records them by jobs on the copy of the ground. Large
/// changes are written in portions, because the jobs' thread also serves others. A failed write
/// ends the recording with a warning; the site continues.
class LiveMcap {
 public:
  /// Begins with the first fed state, in a file with a free name: soil.mcap, soil_1.mcap and so on.
  /// @param copy the ground that jobs read; jobs must end before this object
  /// @param forces note_force() is called
  LiveMcap(const std::filesystem::path& folder, LiveSite& site, const Ground& copy, bool forces);

  /// Notes the force on a bucket after a state of it.
  void note_force(std::size_t machine);
  /// Notes loads and changes of the ground, and starts a job to record them.
  void tick(std::span<const Coord3> changed, GroundCopy& beside);
  /// Starts a job that writes the rest and ends the file.
  void finish(GroundCopy& beside);

 private:
  using Clock = std::chrono::steady_clock;
  struct LoadAt {
    double time_s = 0;
    std::size_t machine = 0;
    SoilMcap::Load load;
  };
  struct ForceAt {
    double time_s = 0;
    std::size_t machine = 0;
    Pose world_from_bucket;
    std::array<double, 6> force;
  };
  /// Changes to record.
  struct News {
    double time_s = 0;
    std::vector<Coord3> changed = {};
    std::vector<LoadAt> loads = {};
    std::vector<ForceAt> forces = {};
    bool last = false;
  };

  double now_s() const;
  void note_loads();
  void hand_over(GroundCopy& beside, bool last);
  void record(const News& news);

  LiveSite& site_;
  const bool forces_;
  const Clock::time_point begin_ = Clock::now();
  std::vector<LoadAt> noted_;  // the last of each machine
  News news_;
  std::atomic<bool> busy_ = false;

  // Used by jobs only.
  const std::filesystem::path folder_;
  const Ground& copy_;
  std::vector<std::string> machines_;
  const std::string crs_wkt_;
  std::optional<SoilMcap> mcap_;
  bool behind_ = false, failed_ = false;
};

}  // namespace soilvdb::tools
