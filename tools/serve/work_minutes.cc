// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/work_minutes.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace soilvdb::tools {
namespace {

constexpr double kFarthest_s = 1e12;  // minutes of later times are not told apart

}  // namespace

void Work::add_state(double time_s) {
  first_s = std::min(first_s.value_or(time_s), time_s);
  last_s = std::max(last_s.value_or(time_s), time_s);
}

Work& Work::operator+=(const Work& other) {
  cut += other.cut;
  loaded += other.loaded;
  put_down += other.put_down;
  hauled = hauled && other.hauled ? std::optional(*hauled + *other.hauled) : std::nullopt;
  cycles += other.cycles;
  cycle_loads_m3 += other.cycle_loads_m3;
  working_s += other.working_s;
  idle_s += other.idle_s;
  for (const std::optional<double>& time_s : {other.first_s, other.last_s})
    if (time_s) add_state(*time_s);
  return *this;
}

std::int64_t WorkMinutes::minute_of(double time_s) {
  return static_cast<std::int64_t>(
      std::floor(std::clamp(time_s, -kFarthest_s, kFarthest_s) / kMinute_s));
}

std::int64_t WorkMinutes::hour_of(std::int64_t minute) {
  return minute >= 0 ? minute / kPerHour : -((-minute + kPerHour - 1) / kPerHour);
}

/// An hour that no copy shares.
WorkMinutes::Hour& WorkMinutes::own(std::int64_t hour) {
  SharedHour& of = hours_[hour];
  if (of.shared) of = SharedHour{std::make_shared<Hour>(*of.minutes)};
  return *of.minutes;
}

Work& WorkMinutes::at(double time_s) {
  const std::int64_t minute = minute_of(time_s), hour = hour_of(minute);
  Minute& of = own(hour)[static_cast<std::size_t>(minute - hour * kPerHour)];
  of.used = true;
  return of.work;
}

void WorkMinutes::spread(double from_s, double to_s, double Work::*duration) {
  while (from_s < to_s) {
    const double next_s = static_cast<double>(minute_of(from_s) + 1) * kMinute_s;
    const double until_s = next_s > from_s ? std::min(to_s, next_s) : to_s;
    at(from_s).*duration += until_s - from_s;
    from_s = until_s;
  }
}

void WorkMinutes::end_at(double time_s) {
  Work later;
  bool any = false;
  const std::int64_t minute = minute_of(time_s), hour = hour_of(minute);
  visit(minute + 1, std::numeric_limits<std::int64_t>::max(), [&](std::int64_t, const Work& work) {
    later += work;
    any = true;
  });
  hours_.erase(hours_.upper_bound(hour), hours_.end());
  if (hours_.contains(hour)) {
    Hour& of = own(hour);
    std::fill(of.begin() + (minute - hour * kPerHour) + 1, of.end(), Minute());
  }
  if (!any) return;
  if (later.first_s) later.first_s = later.last_s = time_s;
  at(time_s) += later;
}

std::optional<std::int64_t> WorkMinutes::first() const {
  if (hours_.empty()) return {};
  const auto& [hour, shared] = *hours_.begin();
  const auto minute = std::find_if(shared.minutes->begin(), shared.minutes->end(),
                                   [](const Minute& of) { return of.used; });
  return hour * kPerHour + (minute - shared.minutes->begin());
}

std::optional<std::int64_t> WorkMinutes::last() const {
  if (hours_.empty()) return {};
  const auto& [hour, shared] = *hours_.rbegin();
  const auto minute = std::find_if(shared.minutes->rbegin(), shared.minutes->rend(),
                                   [](const Minute& of) { return of.used; });
  return hour * kPerHour + (shared.minutes->rend() - minute) - 1;
}

}  // namespace soilvdb::tools
