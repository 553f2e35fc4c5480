// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soil.mcap of a live site, written beside its feeds.
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <set>
#include <span>
#include <vector>

#include "soilvdb/chunk_range.h"
#include "soilvdb/ground_service.h"
#include "tools/run/ground_mcap.h"
#include "tools/serve/live_site.h"

namespace soilvdb::tools {

/// Gathers what changed on the thread that feeds the site, and writes it twice a second on that of
/// a GroundService, which reads the copy of the ground there; more often, some at a time, where
/// much has changed. What can't be written ends the
/// recording with a warning; the site goes on.
class LiveMcap {
 public:
  /// Begins with the first state that is fed, in a file of a name that is free: soil.mcap,
  /// soil_1.mcap and so on.
  /// @param copy the service's
  LiveMcap(const std::filesystem::path& folder, const LiveSite& site, const Soil& copy);
  ~LiveMcap();
  LiveMcap(const LiveMcap&) = delete;
  LiveMcap& operator=(const LiveMcap&) = delete;

  /// Notes what changed, which the service was told, and has it written when it is time.
  void tick(std::span<const Coord3> changed, GroundService& service);
  /// Has the rest written and ends the file, by the time that the service has ended.
  void finish(GroundService& service);

 private:
  using Clock = std::chrono::steady_clock;
  struct LoadAt {
    double time_s = 0;
    std::size_t machine = 0;
    SoilMcap::Load load;
  };
  struct Writer;  // on the service's thread

  double now_s() const;
  void note_loads();
  std::vector<Coord3> take_changed(std::size_t most);
  void write(GroundService& service, bool last);

  const LiveSite& site_;
  const Clock::time_point begin_ = Clock::now();
  Clock::time_point written_{};
  std::set<Coord3, Before> changed_;
  Coord3 last_taken_ = Coord3::Zero();
  std::vector<LoadAt> loads_;  // that aren't written
  std::vector<LoadAt> noted_;  // the last of each machine
  std::shared_ptr<Writer> writer_;
};

}  // namespace soilvdb::tools
