// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Plays a scenario's motions in real time, or faster.
#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "soilvdb/io/scenario.h"
#include "tools/serve/live_site.h"

namespace soilvdb::tools {

/// Feeds a site like its machines: every row, and states between rows.
class Player {
 public:
  /// Continues from the machines' present states.
  /// @param speed seconds of motion per second, > 0
  Player(LiveSite& site, const io::Scenario& scenario, double speed);

  /// Feeds the states that are due. @throw std::runtime_error if the site refuses one
  void go_on();
  /// Have all motions ended?
  bool done() const;

 private:
  using Clock = std::chrono::steady_clock;
  struct Track {
    const io::MotionFile* motion;
    std::size_t part = 0, row = 0;  ///< to feed next
    std::shared_ptr<const Motion> rows = {};
    std::optional<double> fed_s = {};  ///< the last time fed
    bool done = false;
  };
  void feed(std::size_t machine, double time_s);
  void next_row(Track& track);

  LiveSite& site_;
  double speed_;
  std::vector<Track> tracks_;
  double begin_s_ = 0;
  std::optional<Clock::time_point> begun_ = {};
};

}  // namespace soilvdb::tools
