// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Which machine moves when: the updates of a run, in the order of time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/motion.h"

namespace soilvdb::tools {

/// One update: machine `machine` moves on over [begin_s, end_s].
struct Step {
  std::size_t machine = 0;
  double begin_s = 0, end_s = 0;
};

/// The updates of several machines, merged by the time at which they end; at equal times in the
/// order of the machines. A machine's steps follow on each other and cover its whole motion.
class Schedule {
 public:
  /// @param motions outlive the schedule
  /// @param updates even intervals of each motion; without it one update per row, of which the
  ///        first places the bucket. A motion of one row always makes one update.
  Schedule(std::vector<const Motion*> motions, std::optional<std::int64_t> updates);

  std::int64_t total() const { return total_; }
  double begin_s() const { return begin_s_; }  ///< of the earliest motion
  double end_s() const { return end_s_; }      ///< of the latest

  std::optional<Step> next();

 private:
  struct Cursor {
    const Motion* motion;
    std::int64_t count, done = 0;
    bool by_rows;
    double at_s;  ///< where the last step ended
    double until_s() const;
  };
  std::vector<Cursor> cursors_;
  std::int64_t total_ = 0;
  double begin_s_ = 0, end_s_ = 0;
};

}  // namespace soilvdb::tools
