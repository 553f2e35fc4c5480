// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/file/instant.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kMinute_s = 60, kHour_s = 3600, kWeek_s = 604800;
constexpr double kGpsBegin_s = 315964800;  // 1980-01-06T00:00:00Z
constexpr double kGpsAhead_s = 18, kFirstGpsWeek = 1930, kLastGpsWeek = 1e5;

[[noreturn]] void refuse(std::string_view text, std::string_view why) {
  throw std::invalid_argument(fmt::format(
      "'{}' {}; a time in ISO 8601 is such as 2026-05-01T07:00:00.25+02:00", printable(text), why));
}

/// Takes what a text begins with.
class DateReader {
 public:
  explicit DateReader(std::string_view text) : left_(text) {}

  bool is_done() const { return left_.empty(); }
  bool take(char wanted) {
    if (left_.empty() || left_.front() != wanted) return false;
    left_.remove_prefix(1);
    return true;
  }
  /// A number of so many digits.
  std::optional<int> digits(std::size_t count) {
    int value = 0;
    if (left_.size() < count) return {};
    for (const char c : left_.substr(0, count)) {
      if (c < '0' || c > '9') return {};
      value = 10 * value + (c - '0');
    }
    left_.remove_prefix(count);
    return value;
  }
  /// Digits behind a point; 0 without it.
  std::optional<double> fraction() {
    if (!take('.') && !take(',')) return 0;
    const std::size_t count = std::min(left_.find_first_not_of("0123456789"), left_.size());
    if (count == 0) return {};
    const auto value = parsed<double>(fmt::format("0.{}", left_.substr(0, count)));
    left_.remove_prefix(count);
    return value;
  }

 private:
  std::string_view left_;
};

}  // namespace

bool is_date(std::string_view text) {
  return DateReader(text).digits(4) && text.size() > 4 && text[4] == '-';
}

double date_time_s(std::string_view text) {
  constexpr const char* kForm = "is no date and time of day";
  DateReader in(text);
  /// @param begins is what is before the number there?
  const auto number = [&](bool begins, std::size_t digits) {
    const std::optional<int> found = begins ? in.digits(digits) : std::nullopt;
    if (!found) refuse(text, kForm);
    return *found;
  };
  const int year = number(true, 4), month = number(in.take('-'), 2), day = number(in.take('-'), 2);
  const int hour = number(in.take('T') || in.take('t') || in.take(' '), 2);
  const int minute = number(in.take(':'), 2);
  const bool has_second = in.take(':');
  const int second = has_second ? number(true, 2) : 0;
  const std::optional<double> fraction = has_second ? in.fraction() : 0;
  if (!fraction) refuse(text, kForm);
  const std::chrono::year_month_day date(std::chrono::year(year),
                                         std::chrono::month(static_cast<unsigned>(month)),
                                         std::chrono::day(static_cast<unsigned>(day)));
  if (!date.ok() || hour > 23 || minute > 59 || second > 59) refuse(text, "is not in the calendar");
  double ahead_s = 0;
  if (!in.take('Z') && !in.take('z')) {
    const bool east = in.take('+');
    if (!east && !in.take('-'))
      refuse(text, in.is_done() ? "has no offset from UTC, such as Z or +02:00" : kForm);
    const int hours = number(true, 2);
    in.take(':');
    const int minutes = in.is_done() ? 0 : number(true, 2);
    if (hours > 23 || minutes > 59) refuse(text, kForm);
    ahead_s = (east ? 1 : -1) * (hours * kHour_s + minutes * kMinute_s);
  }
  if (!in.is_done()) refuse(text, kForm);
  const auto days = std::chrono::sys_days(date).time_since_epoch();
  const double whole_s = static_cast<double>(std::chrono::seconds(days).count()) + hour * kHour_s +
                         minute * kMinute_s - ahead_s + second;
  return whole_s + *fraction;
}

double gps_time_s(double week, double seconds) {
  if (!(week >= kFirstGpsWeek && week <= kLastGpsWeek && week == std::floor(week)))
    throw std::invalid_argument(
        fmt::format("the GPS week is {}; it must be a whole number from {}, of 2017, on: weeks "
                    "since 1980-01-06, which do not begin anew after 1024",
                    week, kFirstGpsWeek));
  if (!(seconds >= 0 && seconds < kWeek_s))
    throw std::invalid_argument(fmt::format(
        "the second of the GPS week is {}; it must be from 0 to below {}", seconds, kWeek_s));
  return kGpsBegin_s + kWeek_s * week - kGpsAhead_s + seconds;
}

}  // namespace soilvdb::inline v0::io
