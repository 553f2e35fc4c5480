// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soil.mcap of a live site, written beside its feeds.
#pragma once

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

/// Gathers what changed on the thread that feeds the site, and has it recorded in jobs on the copy
/// of the ground there. Where much has changed it is written some at a time, more often: others
/// have jobs there, too. What can't be written ends the recording with a warning; the site goes on.
class LiveMcap {
 public:
  /// Begins with the first state that is fed, in a file of a name that is free: soil.mcap,
  /// soil_1.mcap and so on.
  /// @param copy what the jobs read. They end before this does
  LiveMcap(const std::filesystem::path& folder, const LiveSite& site, const Ground& copy);

  /// Notes loads and what changed of the ground, and has them recorded.
  void tick(std::span<const Coord3> changed, GroundCopy& beside);
  /// Has the rest written and ends the file, by the time that the jobs have ended.
  void finish(GroundCopy& beside);

 private:
  using Clock = std::chrono::steady_clock;
  struct LoadAt {
    double time_s = 0;
    std::size_t machine = 0;
    SoilMcap::Load load;
  };
  /// What is new, to be recorded.
  struct News {
    double time_s = 0;
    std::vector<Coord3> changed = {};
    std::vector<LoadAt> loads = {};
    bool last = false;
  };

  double now_s() const;
  void note_loads();
  void hand_over(GroundCopy& beside, bool last);
  void record(const News& news);

  const LiveSite& site_;
  const Clock::time_point begin_ = Clock::now();
  std::vector<LoadAt> noted_;  // the last of each machine
  News news_;
  std::atomic<bool> busy_ = false;

  // Of the jobs.
  const std::filesystem::path folder_;
  const Ground& copy_;
  std::vector<std::string> machines_;
  const std::string crs_wkt_;
  std::optional<SoilMcap> mcap_;
  bool behind_ = false, failed_ = false;
};

}  // namespace soilvdb::tools
