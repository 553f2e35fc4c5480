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

/// Feeds a site as its machines would: every row, and where they are between rows.
class Player {
 public:
  /// Goes on where the site's machines are.
  /// @param speed seconds of motion a second, > 0
  Player(LiveSite& site, const io::Scenario& scenario, double speed);

  /// Feeds what has come up. @throw std::runtime_error if the site doesn't take it
  void go_on();
  /// Have all motions come to their end?
  bool done() const;

 private:
  using Clock = std::chrono::steady_clock;
  struct Track {
    const io::MotionFile* motion;
    std::size_t part = 0, row = 0;  ///< next to be fed
    std::shared_ptr<const Motion> rows;
    double fed_s;  ///< NaN: nothing was
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
