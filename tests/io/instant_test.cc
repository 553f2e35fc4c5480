// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/file/instant.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <ctime>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>

namespace soilvdb::io {
namespace {

using testing::HasSubstr;

/// Against the C library's calendar.
TEST(Instants, AreUnixTimesWhateverTheirOffset) {
  std::mt19937_64 random(1);
  std::uniform_int_distribution<std::time_t> any(-2'000'000'000, 4'000'000'000);
  std::uniform_int_distribution<int> minutes(-23 * 60 - 59, 23 * 60 + 59), thousandths(0, 999);
  for (int i = 0; i < 2000; ++i) {
    const std::time_t time_s = any(random);
    const int ahead = minutes(random), fraction = thousandths(random);
    const std::time_t there_s = time_s + 60 * ahead;
    std::tm there = {};
    ASSERT_NE(gmtime_r(&there_s, &there), nullptr);
    const std::string date =
        fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}{}{:02}:{:02}", there.tm_year + 1900,
                    there.tm_mon + 1, there.tm_mday, there.tm_hour, there.tm_min, there.tm_sec,
                    fraction, ahead < 0 ? '-' : '+', std::abs(ahead) / 60, std::abs(ahead) % 60);
    EXPECT_TRUE(is_date(date));
    EXPECT_EQ(date_time_s(date), static_cast<double>(time_s) + fraction / 1000.0) << date;
  }
}

TEST(Instants, MayBeWrittenInSeveralForms) {
  const double right = 1777618800;
  for (const char* date :
       {"2026-05-01T07:00:00Z", "2026-05-01 07:00:00Z", "2026-05-01t07:00z", "2026-05-01T07:00Z",
        "2026-05-01T09:00:00+02:00", "2026-05-01T09:00:00+0200", "2026-05-01T01:30:00,000-05:30"})
    EXPECT_EQ(date_time_s(date), right) << date;
  EXPECT_EQ(date_time_s("2026-05-01T07:00:00.25Z"), right + 0.25);
  EXPECT_EQ(date_time_s("2024-02-29T00:00:00Z"), 1709164800);
  EXPECT_EQ(date_time_s("1970-01-01T00:00:00+00"), 0);
}

TEST(Instants, NumbersAreNoDates) {
  for (const char* text : {"", "2026", "-2026-05", "12.5", "1e-5", "20260501", "202-05-01"})
    EXPECT_FALSE(is_date(text)) << text;
}

TEST(Instants, AreRefusedInWords) {
  for (const auto& [date, why] : std::initializer_list<std::pair<const char*, const char*>>{
           {"2026-05-01T07:00:00", "has no offset from UTC, such as Z or +02:00"},
           {"2026-05-01", "is no date and time of day"},
           {"2026-05-01T7:00:00Z", "is no date and time of day"},
           {"2026-05-01T09+02", "is no date and time of day"},
           {"2026-05-01T07:00:00.Z", "is no date and time of day"},
           {"2026-05-01T07:00:00Z ", "is no date and time of day"},
           {"2026-05-01T07:00:00+2", "is no date and time of day"},
           {"2026-05-01T07:00:00+02:60", "is no date and time of day"},
           {"2026-05-01T07:00:00 CEST", "is no date and time of day"},
           {"2026-02-29T07:00:00Z", "is not in the calendar"},
           {"2026-13-01T07:00:00Z", "is not in the calendar"},
           {"2026-05-01T24:00:00Z", "is not in the calendar"},
           {"2026-05-01T07:60:00Z", "is not in the calendar"},
           {"2026-05-01T07:00:60Z", "is not in the calendar"}}) {
    try {
      date_time_s(date);
      ADD_FAILURE() << date;
    } catch (const std::invalid_argument& e) {
      EXPECT_THAT(e.what(), HasSubstr(std::string(date) + "' " + why));
      EXPECT_THAT(e.what(), HasSubstr("2026-05-01T07:00:00.25+02:00"));
    }
  }
}

TEST(Instants, OfGpsAreAheadOfUtc) {
  // 2017-01-01T00:00:00Z, when the newest leap second had passed.
  EXPECT_EQ(gps_time_s(1930, 18), date_time_s("2017-01-01T00:00:00Z"));
  EXPECT_EQ(gps_time_s(2416, 450018.5), date_time_s("2026-05-01T05:00:00.5Z"));
  for (const auto& [week, second] : std::initializer_list<std::pair<double, double>>{{1929, 0},
                                                                                     {392, 0},
                                                                                     {2416.5, 0},
                                                                                     {NAN, 0},
                                                                                     {1e9, 0},
                                                                                     {2416, -1},
                                                                                     {2416, 604800},
                                                                                     {2416, NAN}})
    EXPECT_THROW(gps_time_s(week, second), std::invalid_argument) << week << " " << second;
}

}  // namespace
}  // namespace soilvdb::io
