// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A machine's work by minute, from which reports of any period are summed.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>

namespace soilvdb::tools {

/// Work of a machine in a span of time. Counts are integers, so sums are exact in any order.
struct Work {
  std::int64_t cut = 0;                    ///< samples
  std::int64_t loaded = 0, put_down = 0;   ///< mass into and out of the bucket, units of mass
  std::optional<std::int64_t> hauled = 0;  ///< the part into hoppers; empty: not recorded
  std::int64_t cycles = 0;
  double cycle_loads_m3 = 0;  ///< largest loads of these cycles, loose
  double working_s = 0, idle_s = 0;
  std::optional<double> first_s = {}, last_s = {};  ///< times of its states

  void add_state(double time_s);
  Work& operator+=(const Work& other);
};

/// Copies share what they do not change, so a copy takes a tenth of a microsecond for an hour.
/// Different threads may use copies, but only one thread may copy the same object.
class WorkMinutes {
 public:
  static constexpr double kMinute_s = 60;
  static std::int64_t minute_of(double time_s);

  /// The work of the minute that has this time.
  Work& at(double time_s);
  /// Spreads a duration over its minutes. @param duration Work::working_s or idle_s
  void spread(double from_s, double to_s, double Work::*duration);
  /// Work that was booked later counts at this time: the machine's clock was ahead.
  void end_at(double time_s);

  /// First and last minute with work; empty if there is none.
  std::optional<std::int64_t> first() const, last() const;
  /// Calls `use(minute, work)` for the minutes with work in [from, to), in order.
  template <typename Use>
  void visit(std::int64_t from, std::int64_t to, const Use& use) const {
    for (auto hour = hours_.lower_bound(hour_of(from)); hour != hours_.end(); ++hour) {
      for (std::int64_t i = 0; i < kPerHour; ++i) {
        const std::int64_t minute = hour->first * kPerHour + i;
        if (minute >= to) return;
        const Minute& of = (*hour->second.minutes)[static_cast<std::size_t>(i)];
        if (minute >= from && of.used) use(minute, of.work);
      }
    }
  }

 private:
  static constexpr std::int64_t kPerHour = 60;
  struct Minute {
    Work work = {};
    bool used = false;
  };
  using Hour = std::array<Minute, kPerHour>;
  struct SharedHour {
    SharedHour() = default;
    explicit SharedHour(std::shared_ptr<Hour> own) : minutes(std::move(own)) {}
    SharedHour(const SharedHour& other) : minutes(other.minutes), shared(true) {
      if (!other.shared) other.shared = true;
    }
    SharedHour& operator=(SharedHour&&) = default;
    SharedHour& operator=(const SharedHour&) = delete;
    std::shared_ptr<Hour> minutes = std::make_shared<Hour>();
    mutable bool shared = false;  ///< changed only in a copy of its own
  };
  static std::int64_t hour_of(std::int64_t minute);
  Hour& own(std::int64_t hour);
  std::map<std::int64_t, SharedHour> hours_;
};

}  // namespace soilvdb::tools
