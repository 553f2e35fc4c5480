// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Times of snapshots: multiples of an interval since the beginning.
#pragma once

#include <cmath>
#include <optional>

namespace soilvdb::tools {

class SnapshotSchedule {
 public:
  SnapshotSchedule(std::optional<double> every_s, double begin_s, double end_s)
      : every_s_(every_s), begin_s_(begin_s), slack_s_(1e-9 * (end_s - begin_s)) {}

  /// Begins at the time of the first call of due().
  explicit SnapshotSchedule(std::optional<double> every_s) : every_s_(every_s) {}

  /// Has a snapshot come due since this last returned true?
  bool due(double time_s) {
    if (!begin_s_) begin_s_ = time_s;
    if (!would_be_due(time_s)) return false;
    count_ = count(time_s);
    return true;
  }
  /// Starts again at the next time, because the times so far were of a wrong clock.
  void begin_again() { *this = SnapshotSchedule(every_s_); }
  bool would_be_due(double time_s) const { return every_s_ && count(time_s) > count_; }

 private:
  double count(double time_s) const {
    return std::floor((time_s + slack_s_ - begin_s_.value_or(time_s)) / *every_s_);
  }

  std::optional<double> every_s_, begin_s_ = {};
  double slack_s_ = 0, count_ = 0;
};

}  // namespace soilvdb::tools
