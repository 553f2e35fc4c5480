// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/report_progress.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "io/file/text.h"

namespace soilvdb::tools {
namespace {

/// Axes name hours and minutes; shorter recordings need seconds.
constexpr double kShort_s = 600;

std::string with_capital(std::string text) {
  if (!text.empty() && text[0] >= 'a' && text[0] <= 'z')
    text[0] = static_cast<char>(text[0] - 'a' + 'A');
  return text;
}

std::string progress_row(const Report& report, const Progress& of, const ChartTicks& moment,
                         const std::string& unit) {
  std::string row = "<tr><th scope=\"row\">" + io::markup_text(of.name) + "</th>";
  const auto add = [&](const std::string& name, const std::string& value) {
    row += fmt::format("<td data-name=\"{}\">{}</td>", name, value);
  };
  const bool known = of.why_nothing.empty();
  const auto volume = [&](std::optional<double> m3) {
    if (!m3 || !known) return std::string("–");
    const double value = report.in_volume_unit(*m3);
    return chart_number(value, std::abs(value) >= 100 ? 0 : std::abs(value) >= 10 ? 1 : 2);
  };
  add("Still to cut, " + unit, volume(of.now.cut_m3));
  add("Still to fill, " + unit, volume(of.now.fill_m3));
  add("Done", of.done ? chart_number(100 * *of.done, 0) + " %" : "–");
  add("Rate, " + unit + "/h", volume(of.per_h));
  add("Work left, h", of.left_h ? chart_number(*of.left_h, *of.left_h < 10 ? 1 : 0) : "–");
  add("Expected end", of.end_s ? moment(*of.end_s) : "–");
  return row + "</tr>\n";
}

std::string progress_chart(const Report& report, const Progress& of, const ChartTicks& ticks) {
  // Fill first: its blue is that of fill on the site's page.
  ChartSeries fill{"Still to fill", {}}, cut{"Still to cut", {}};
  for (const Remaining& at : of.at) {
    fill.values.push_back(report.in_volume_unit(at.fill_m3));
    cut.values.push_back(report.in_volume_unit(at.cut_m3));
  }
  const bool is_short = of.times_s.back() - of.times_s.front() < kShort_s;
  const ChartTicks seconds = [&](double time_s) {
    const auto s = static_cast<std::int64_t>(std::floor(time_s - of.times_s.front()));
    return fmt::format("{}:{:02}", s / 60, s % 60);
  };
  return value_chart({std::move(fill), std::move(cut)}, of.times_s, is_short ? seconds : ticks);
}

}  // namespace

std::string progress_html(const Report& report, const ChartTicks& ticks, const ChartTicks& moment,
                          const std::string& unit) {
  const std::vector<Progress>& all = report.progress();
  if (all.empty()) return "";
  std::string html = "<h2>Progress to design</h2>\n";
  const auto timed =
      std::find_if(all.begin(), all.end(), [](const Progress& of) { return !of.times_s.empty(); });
  if (timed != all.end())
    html += "<p class=\"faint\">As of " + moment(timed->times_s.back()) +
            ", whatever period the rest of this report has.</p>\n";
  html += "<table class=\"areas\"><thead><tr><th scope=\"col\">Area</th>";
  for (const std::string& name :
       {"Still to cut<br>" + unit, "Still to fill<br>" + unit, std::string("Done"),
        "Rate<br>" + unit + "/h", std::string("Work left<br>h"), std::string("Expected end")})
    html += "<th scope=\"col\">" + name + "</th>";
  html += "</tr></thead><tbody>\n";
  for (const Progress& of : all) html += progress_row(report, of, moment, unit);
  html += "</tbody></table>\n<div class=\"charts\">\n";
  for (const Progress& of : all) {
    const bool draws = of.times_s.size() > 1 && of.times_s.back() > of.times_s.front();
    const std::string note = with_capital(of.why_nothing.empty() ? of.note : of.why_nothing);
    html += fmt::format(
        "<figure><figcaption>{}{}</figcaption>{}{}</figure>\n", io::markup_text(of.name),
        draws ? ", " + unit : "", draws ? progress_chart(report, of, ticks) : "",
        note.empty() ? "" : "<p class=\"faint\">" + io::markup_text(note) + ".</p>");
  }
  return html + "</div>\n";
}

}  // namespace soilvdb::tools
