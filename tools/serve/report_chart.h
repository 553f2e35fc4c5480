// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Charts of amounts over time, as SVG in a page.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace soilvdb::tools {

struct ChartSeries {
  std::string name;
  std::vector<double> values;    ///< by period
  const char* colour = nullptr;  ///< null: one that differs from those of the others
};
/// The text of a time on the axis.
using ChartTicks = std::function<std::string(double time_s)>;

/// A number with this many decimals, and thin spaces between thousands from 10 000 on.
std::string chart_number(double value, int decimals);

/// Values per period, stacked, and a key. Of many periods, several make a bar.
/// @param ends_s of periods, after the begin of the first
std::string bar_chart(std::vector<ChartSeries> series, std::vector<double> ends_s,
                      const ChartTicks& ticks);
/// Values at times, and a key.
std::string value_chart(const std::vector<ChartSeries>& series, const std::vector<double>& times_s,
                        const ChartTicks& ticks);
/// Sums up to the end of each period, and a key.
std::string line_chart(std::vector<ChartSeries> series, const std::vector<double>& ends_s,
                       const ChartTicks& ticks);

}  // namespace soilvdb::tools
