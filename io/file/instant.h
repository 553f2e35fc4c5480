// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Times of calendars and of satellite receivers as Unix times.
#pragma once

#include <string_view>

namespace soilvdb::inline v0::io {

/// Is it meant as a date, and no number?
bool is_date(std::string_view text);
/// Seconds since 1970-01-01T00:00:00Z of a date and time of day in ISO 8601 with its offset from
/// UTC, such as 2026-05-01T07:00:00.25+02:00. Leap seconds do not count, as in Unix times.
/// @throw std::invalid_argument that says what would be right
double date_time_s(std::string_view text);
/// The same of a GPS time: weeks since 1980-01-06, which do not begin anew after 1024, and seconds
/// of that week. @throw std::invalid_argument as above, also before week 1930, 2017-01-01: only
/// from then on GPS is 18 s ahead of UTC (IERS, Bulletin C 52).
double gps_time_s(double week, double seconds);

}  // namespace soilvdb::inline v0::io
