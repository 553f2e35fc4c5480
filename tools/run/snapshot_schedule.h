// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// When snapshots are due: at every multiple of an interval since the beginning.
#pragma once

#include <cmath>
#include <limits>
#include <optional>

namespace soilvdb::tools {

class SnapshotSchedule {
 public:
  SnapshotSchedule(std::optional<double> every_s, double begin_s, double end_s)
      : every_s_(every_s), begin_s_(begin_s), slack_s_(1e-9 * (end_s - begin_s)) {}

  /// Begins with the first time that due() is asked for.
  explicit SnapshotSchedule(std::optional<double> every_s) : every_s_(every_s) {}

  /// Has one come due since the last time this said so?
  bool due(double time_s) {
    if (std::isnan(begin_s_)) begin_s_ = time_s;
    if (!would_be_due(time_s)) return false;
    count_ = count(time_s);
    return true;
  }
  /// From the next time on: times before it were of a clock that was wrong.
  void begin_again() { *this = SnapshotSchedule(every_s_); }
  bool would_be_due(double time_s) const { return every_s_ && count(time_s) > count_; }

 private:
  double count(double time_s) const {
    return std::floor((time_s + slack_s_ - begin_s_) / *every_s_);
  }

  std::optional<double> every_s_;
  double begin_s_ = std::numeric_limits<double>::quiet_NaN(), slack_s_ = 0, count_ = 0;
};

}  // namespace soilvdb::tools
