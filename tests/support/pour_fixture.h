// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground made of columns to pour on, and what came of it.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <numbers>
#include <utility>
#include <vector>

#include "core/settle/pour.h"

namespace soilvdb::test {

inline constexpr double kSide_m = 0.05;
inline const double kPourSlope = std::tan(35 * std::numbers::pi / 180);

/// Only with the environment variable SOILVDB_TABLE set.
template <typename... Args>
void print(fmt::format_string<Args...> format, Args&&... args) {
  if (std::getenv("SOILVDB_TABLE") != nullptr) fmt::print(format, std::forward<Args>(args)...);
}

using Surface = std::function<double(double x_m, double y_m)>;

/// The middle of column (x, y).
inline Vec2 middle_m(const Columns& c, int column) {
  return c.side_m * Vec2(column / c.ny + 0.5, column % c.ny + 0.5);
}

inline Columns columns_of(double length_m, double width_m, double side_m, const Surface& ground) {
  Columns c(static_cast<int>(std::lround(length_m / side_m)),
            static_cast<int>(std::lround(width_m / side_m)), side_m);
  for (int i = 0; i < c.nx * c.ny; ++i) c.at(i) = ground(middle_m(c, i).x(), middle_m(c, i).y());
  c.firm_m = c.height_m;
  return c;
}

inline double volume_between(const Columns& before, const Columns& after) {
  double sum = 0;
  for (std::size_t i = 0; i < after.height_m.size(); ++i)
    sum += after.height_m[i] - before.height_m[i];
  return sum * after.side_m * after.side_m;
}

/// Differences of heights, columns' sides.
struct Difference {
  double rms = 0, p99 = 0, max = 0;
  std::size_t columns = 0;
};

/// Over the columns that either raised.
inline Difference difference(const Columns& before, const Columns& a, const Columns& b) {
  std::vector<double> off;
  double squares = 0;
  for (std::size_t i = 0; i < a.height_m.size(); ++i) {
    if (a.height_m[i] == before.height_m[i] && b.height_m[i] == before.height_m[i]) continue;
    off.push_back(std::abs(a.height_m[i] - b.height_m[i]) / a.side_m);
    squares += off.back() * off.back();
  }
  if (off.empty()) return {};
  std::sort(off.begin(), off.end());
  return {std::sqrt(squares / static_cast<double>(off.size())), off[off.size() * 99 / 100],
          off.back(), off.size()};
}

}  // namespace soilvdb::test
