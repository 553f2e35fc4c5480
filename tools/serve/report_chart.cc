// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/report_chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "io/file/text.h"

namespace soilvdb::tools {
namespace {

// As wide as a phone, where texts are then as large as others.
constexpr double kWidth = 360, kHeight = 196, kLeft = 50, kRight = 350, kTop = 10, kBase = 170;
constexpr std::size_t kMostBars = 60;
constexpr double kYTicks = 4, kXTicks = 4;
/// Colours that differ for all eyes, and as greys next to each other.
constexpr const char* kChartColours[] = {"#0b6fa4", "#e39b2d", "#1f7a5c", "#c25a8a",
                                         "#76b7dd", "#7a4f1d", "#9a86d8", "#5a646b"};

const char* colour_of(const std::vector<ChartSeries>& series, std::size_t i) {
  return series[i].colour != nullptr ? series[i].colour
                                     : kChartColours[i % std::size(kChartColours)];
}

/// 1, 2 or 5 times a power of ten, at least `about`.
double round_up_125(double about) {
  const double decade = std::pow(10, std::floor(std::log10(about)));
  for (const double step : {1.0, 2.0, 5.0})
    if (step * decade >= about * (1 - 1e-9)) return step * decade;
  return 10 * decade;
}

struct ChartAxes {
  double step, top, from_s, to_s;

  ChartAxes(double largest, const std::vector<double>& ends_s)
      : step(round_up_125(std::max(largest, 1e-3) / kYTicks)),
        top(step * std::max(1.0, std::ceil(largest / step - 1e-9))),
        from_s(ends_s.front()),
        to_s(ends_s.back()) {}

  double y(double value) const { return kBase - (kBase - kTop) * value / top; }
  double x(double time_s) const {
    return kLeft + (kRight - kLeft) * (time_s - from_s) / (to_s - from_s);
  }

  std::string svg(const std::vector<double>& ends_s, const ChartTicks& ticks) const {
    const int decimals = std::max(0, static_cast<int>(-std::floor(std::log10(step) + 1e-9)));
    std::string out;
    for (int i = 0; i * step <= top * (1 + 1e-9); ++i)
      out += fmt::format(
          "<path d=\"M{} {:.1f}H{}\" stroke=\"{}\"/><text x=\"{}\" y=\"{:.1f}\" "
          "text-anchor=\"end\">{}</text>",
          kLeft, y(i * step), kRight, i == 0 ? "#5a646b" : "#e3e7e9", kLeft - 6, y(i * step) + 4,
          chart_number(i * step, decimals));
    const auto apart =
        static_cast<std::size_t>(std::ceil(static_cast<double>(ends_s.size() - 1) / kXTicks));
    for (std::size_t i = 0; i < ends_s.size(); i += apart)
      out += fmt::format(
          "<path d=\"M{0:.1f} {1}v4\" stroke=\"#5a646b\"/><text x=\"{0:.1f}\" y=\"{2}\" "
          "text-anchor=\"{3}\">{4}</text>",
          x(ends_s[i]), kBase, kBase + 17, x(ends_s[i]) > kRight - 12 ? "end" : "middle",
          ticks(ends_s[i]));
    return out;
  }
};

std::string framed(const std::string& content, const std::vector<ChartSeries>& series) {
  std::string html = fmt::format(
      "<svg class=\"chart\" viewBox=\"0 0 {} {}\" aria-hidden=\"true\">{}"
      "</svg><ul class=\"key\">",
      kWidth, kHeight, content);
  for (std::size_t i = 0; i < series.size(); ++i)
    html += fmt::format(
        "<li><svg viewBox=\"0 0 12 12\" aria-hidden=\"true\"><rect width=\"12\" height=\"12\" "
        "fill=\"{}\"/></svg>{}</li>",
        colour_of(series, i), io::markup_text(series[i].name));
  return html + "</ul>";
}

/// Makes bars of several periods where there are too many.
void merge_periods(std::vector<ChartSeries>& series, std::vector<double>& ends_s) {
  const std::size_t count = ends_s.size() - 1, each = (count + kMostBars - 1) / kMostBars;
  if (each < 2) return;
  std::vector<double> ends = {ends_s.front()};
  for (std::size_t i = 0; i < count; i += each) ends.push_back(ends_s[std::min(i + each, count)]);
  for (ChartSeries& of : series) {
    std::vector<double> sums(ends.size() - 1);
    for (std::size_t i = 0; i < count; ++i) sums[i / each] += of.values[i];
    of.values = std::move(sums);
  }
  ends_s = std::move(ends);
}

/// @param named_s times on the axis
std::string lines_of(const std::vector<ChartSeries>& series, const std::vector<double>& times_s,
                     const std::vector<double>& named_s, const ChartTicks& ticks) {
  double largest = 0;
  for (const ChartSeries& of : series)
    for (const double value : of.values) largest = std::max(largest, value);
  const ChartAxes axes(largest, times_s);
  std::string out = axes.svg(named_s, ticks);
  for (std::size_t k = 0; k < series.size(); ++k) {
    std::string way;
    for (std::size_t i = 0; i < series[k].values.size(); ++i)
      way += fmt::format("{}{:.1f} {:.1f}", i == 0 ? 'M' : 'L', axes.x(times_s[i]),
                         axes.y(series[k].values[i]));
    out += fmt::format(
        "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\" stroke-linejoin=\"round\"/>",
        way, colour_of(series, k));
  }
  return framed(out, series);
}

}  // namespace

std::string chart_number(double value, int decimals) {
  std::string text = fmt::format("{:.{}f}", std::abs(value), decimals);
  const std::size_t whole = std::min(text.find('.'), text.size());
  for (std::size_t at = whole; whole > 4 && at > 3;) text.insert(at -= 3, "\u2009");
  const bool negative = value < 0 && text.find_first_of("123456789") != std::string::npos;
  return (negative ? "−" : "") + text;
}

std::string bar_chart(std::vector<ChartSeries> series, std::vector<double> ends_s,
                      const ChartTicks& ticks) {
  merge_periods(series, ends_s);
  const std::size_t count = ends_s.size() - 1;
  std::vector<double> heights(count);
  for (const ChartSeries& of : series)
    for (std::size_t i = 0; i < count; ++i) heights[i] += of.values[i];
  const double largest = heights.empty() ? 0 : *std::max_element(heights.begin(), heights.end());
  const ChartAxes axes(largest, ends_s);
  std::string out = axes.svg(ends_s, ticks);
  std::vector<double> below(count);
  for (std::size_t k = 0; k < series.size(); ++k) {
    for (std::size_t i = 0; i < count; ++i) {
      const double value = series[k].values[i];
      if (value <= 0) continue;
      const double left = axes.x(ends_s[i]), wide = axes.x(ends_s[i + 1]) - left;
      const double gap = std::min(0.15 * wide, 4.0);
      out += fmt::format(
          "<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" fill=\"{}\"/>",
          left + gap, axes.y(below[i] + value), wide - 2 * gap,
          axes.y(below[i]) - axes.y(below[i] + value), colour_of(series, k));
      below[i] += value;
    }
  }
  return framed(out, series);
}

std::string value_chart(const std::vector<ChartSeries>& series, const std::vector<double>& times_s,
                        const ChartTicks& ticks) {
  const double from_s = times_s.front(), to_s = times_s.back();
  return lines_of(series, times_s, {from_s, (from_s + to_s) / 2, to_s}, ticks);
}

std::string line_chart(std::vector<ChartSeries> series, const std::vector<double>& ends_s,
                       const ChartTicks& ticks) {
  for (ChartSeries& of : series) {
    double sum = 0;
    for (double& value : of.values) value = sum += value;
    of.values.insert(of.values.begin(), 0);
  }
  return lines_of(series, ends_s, ends_s, ticks);
}

}  // namespace soilvdb::tools
