// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The report as a page to read on any screen and to print.
#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <utility>

#include "io/file/text.h"
#include "tools/run/text.h"
#include "tools/serve/report.h"
#include "tools/serve/report_chart.h"
#include "tools/serve/report_progress.h"
#include "tools/serve/report_style.h"

namespace soilvdb::tools {
namespace {

/// Of machines in their order: kMachineColors of tools/view/src/machines.js.
constexpr const char* kMachineColours[] = {"#e69f00", "#56b4e9", "#009e73", "#cc79a7",
                                           "#f0e442", "#0072b2", "#d55e00"};
constexpr double kDay_s = 86400, kHour_s = 3600;

/// Numbers and times as this report shows them, with the same decimals throughout.
class ReportText {
 public:
  explicit ReportText(const Report& report)
      : report_(report),
        dates_(report.has_dates()),
        days_(report.total().to_s - report.total().from_s > kDay_s) {
    const Work all = report.total().all();
    const Report::Row row = report.row(report.total(), {});
    volume_decimals_ = decimals_of(std::max(row.cut, row.put_down));
    mass_decimals_ = decimals_of(row.load.value_or(0));
    hours_ = all.working_s + all.idle_s >= kHour_s;
  }

  const char* volume_unit() const { return report_.query().yards ? "yd³" : "m³"; }
  /// Soil of volumes that are counted in place, and of those counted loose.
  const char* dug_soil() const { return report_.soil_of(ReportQuery::Soil::kBank); }
  const char* moved_soil() const { return report_.soil_of(ReportQuery::Soil::kLoose); }
  const char* mass_unit() const { return report_.query().short_tons ? "short tons" : "t"; }
  const char* duration_unit() const { return hours_ ? "h:min" : "min:s"; }

  std::string volume(std::optional<double> value) const { return number(value, volume_decimals_); }
  std::string mass(std::optional<double> value) const { return number(value, mass_decimals_); }
  static std::string share(std::optional<double> value) {
    return value ? fmt::format("{:.0f} %", 100 * *value) : "–";
  }
  std::string duration(double time_s) const {
    const auto all = static_cast<std::int64_t>(std::llround(hours_ ? time_s / 60 : time_s));
    return fmt::format("{}:{:02}", all / 60, all % 60);
  }
  /// Of a day, or since the clock's beginning.
  std::string time(std::optional<double> time_s, bool with_day = false) const {
    if (!time_s) return "–";
    if (dates_) return date(*time_s, with_day ? "{:%d %b %H:%M}" : "{:%H:%M}");
    const auto minutes = static_cast<std::int64_t>(std::floor(*time_s / 60));
    return fmt::format("{}{}:{:02}", minutes < 0 ? "−" : "", std::abs(minutes) / 60,
                       std::abs(minutes) % 60);
  }
  std::string first_to_last(const Work& work, const Report::Period& of) const {
    if (!work.first_s) return "–";
    const bool two_days = dates_ && day_of(*work.first_s) != day_of(*work.last_s);
    return time(work.first_s, day_of(of.from_s) != day_of(of.to_s - 1)) +
           (two_days ? "–<br>" : "–") + time(work.last_s, two_days);
  }
  /// On an axis.
  std::string tick(double time_s) const {
    return dates_ && days_ ? date(time_s, "{:%d %b}") : time(time_s);
  }
  std::string period(const Report::Period& of) const {
    if (dates_ && is_day(of)) return date(of.from_s, "{:%a %d %b}");
    const bool two_days = dates_ && day_of(of.from_s) != day_of(of.to_s - 1);
    return time(of.from_s, days_) + "–" + time(of.to_s, two_days);
  }
  /// A day and time.
  std::string moment(double time_s) const {
    return dates_ ? date(time_s, "{:%d %B %Y, %H:%M}") + " UTC" : time(time_s) + " h:min";
  }
  std::string whole_time() const {
    const Report::Period& all = report_.total();
    if (!dates_) return time(all.from_s) + " to " + time(all.to_s) + " h:min of the site’s clock";
    constexpr const char* kLong = "{:%d %B %Y, %H:%M}";
    const bool one_day = day_of(all.from_s) == day_of(all.to_s - 1);
    return date(all.from_s, kLong) + " to " + (one_day ? time(all.to_s) : date(all.to_s, kLong)) +
           " UTC";
  }
  /// "hour", "2 hours", "15 minutes".
  std::string every() const {
    const double every_s = report_.query().every_s;
    for (const auto& [unit_s, name] :
         {std::pair(kDay_s, "day"), {kHour_s, "hour"}, {60.0, "minute"}})
      if (std::fmod(every_s, unit_s) == 0)
        return every_s == unit_s ? name
                                 : counted(static_cast<std::uint64_t>(every_s / unit_s), name);
    return "";
  }
  static std::string date(double time_s, const char* format) {
    const std::tm utc = fmt::gmtime(static_cast<std::time_t>(std::floor(time_s)));
    const std::string text = fmt::format(fmt::runtime(format), utc);
    return format[3] == 'd' && text[0] == '0' ? text.substr(1) : text;
  }

 private:
  static int decimals_of(double largest) { return largest >= 100 ? 1 : largest >= 10 ? 2 : 3; }
  static std::string number(std::optional<double> value, int decimals) {
    return value ? chart_number(*value, decimals) : "–";
  }
  static double day_of(double time_s) { return std::floor(time_s / kDay_s); }
  static bool is_day(const Report::Period& of) {
    return of.to_s - of.from_s == kDay_s && std::fmod(of.from_s, kDay_s) == 0;
  }

  const Report& report_;
  bool dates_, days_, hours_;  ///< days_: over more than one
  int volume_decimals_, mass_decimals_;
};

/// A row of a table.
struct ReportLine {
  std::string name;
  const Report::Period* period;
  std::optional<std::size_t> machine;
};

std::string table_cells(const Report& report, const ReportText& text, const ReportLine& line) {
  const Report::Row row = report.row(*line.period, line.machine);
  const Work work = line.machine ? line.period->machines[*line.machine] : line.period->all();
  std::string cells = "<tr><th scope=\"row\">" + io::markup_text(line.name) + "</th>";
  const auto add = [&](const std::string& name, const std::string& value) {
    cells += fmt::format("<td data-name=\"{}\">{}</td>", name, value);
  };
  const std::string volume = text.volume_unit();
  add("Dug, " + volume, text.volume(row.cut));
  add("Put down, " + volume, text.volume(row.put_down));
  if (report.has_hoppers()) add("Hauled, " + volume, text.volume(row.hauled));
  if (report.has_mass()) add(std::string("Load, ") + text.mass_unit(), text.mass(row.load));
  add("Cycles", fmt::format("{}", work.cycles));
  add("Load factor", ReportText::share(row.load_factor));
  add(std::string("Working, ") + text.duration_unit(), text.duration(work.working_s));
  add(std::string("Idle, ") + text.duration_unit(), text.duration(work.idle_s));
  add("Seen", text.first_to_last(work, *line.period));
  return cells + "</tr>\n";
}

std::string table_of(const Report& report, const ReportText& text, std::string_view first,
                     const std::vector<ReportLine>& lines, const ReportLine& total) {
  std::string html = fmt::format("<table class=\"{}\"><thead><tr><th scope=\"col\">{}</th>",
                                 first == "Machine" ? "machines" : "periods", first);
  const auto head = [&](const std::string& name, const std::string& unit) {
    html += fmt::format("<th scope=\"col\">{}{}{}</th>", name, unit.empty() ? "" : "<br>", unit);
  };
  const std::string volume = text.volume_unit();
  head("Dug", volume + ' ' + text.dug_soil());
  head("Put down", volume + ' ' + text.moved_soil());
  if (report.has_hoppers()) head("Hauled", volume + ' ' + text.moved_soil());
  if (report.has_mass()) head("Load", text.mass_unit());
  head("Cycles", "");
  head("Load factor", "");
  head("Working", text.duration_unit());
  head("Idle", text.duration_unit());
  head("Seen", "");
  html += "</tr></thead><tbody>\n";
  for (const ReportLine& line : lines) html += table_cells(report, text, line);
  return html + "</tbody><tfoot>" + table_cells(report, text, total) + "</tfoot></table>\n";
}

std::string sums_of(const Report& report, const ReportText& text) {
  const Report::Row row = report.row(report.total(), {});
  const Work all = report.total().all();
  std::string html = "<dl class=\"sums\">";
  const auto add = [&](const char* name, const std::string& value, const std::string& unit) {
    html += fmt::format("<div><dt>{}</dt><dd>{} <small>{}</small></dd></div>", name, value, unit);
  };
  const std::string volume = text.volume_unit();
  add("Dug", text.volume(row.cut), volume + ' ' + text.dug_soil());
  add("Put down", text.volume(row.put_down), volume + ' ' + text.moved_soil());
  if (report.has_hoppers())
    add("Hauled", text.volume(row.hauled), volume + ' ' + text.moved_soil());
  if (report.has_mass()) add("Load", text.mass(row.load), text.mass_unit());
  add("Cycles", fmt::format("{}", all.cycles), "");
  add("Working", text.duration(all.working_s), text.duration_unit());
  return html + "</dl>\n";
}

std::string charts_of(const Report& report, const ReportText& text) {
  std::vector<double> ends_s = {report.total().from_s};
  std::vector<ChartSeries> cut;
  const std::string moved = std::string(" (") + text.moved_soil() + ')';
  ChartSeries sums[] = {{std::string("Dug (") + text.dug_soil() + ')', {}},
                        {"Put down" + moved, {}},
                        {"Hauled" + moved, {}}};
  for (std::size_t i = 0; i < report.names().size(); ++i)
    cut.push_back({report.names()[i], {}, kMachineColours[i % std::size(kMachineColours)]});
  for (const Report::Period& period : report.periods()) {
    ends_s.push_back(period.to_s);
    for (std::size_t i = 0; i < cut.size(); ++i) cut[i].values.push_back(report.row(period, i).cut);
    const Report::Row all = report.row(period, {});
    sums[0].values.push_back(all.cut);
    sums[1].values.push_back(all.put_down);
    sums[2].values.push_back(all.hauled.value_or(0));
  }
  std::erase_if(cut, [](const ChartSeries& series) {
    return std::all_of(series.values.begin(), series.values.end(), [](double v) { return v == 0; });
  });
  std::vector<ChartSeries> lines(sums,
                                 sums + (report.total().all().hauled.value_or(0) > 0 ? 3 : 2));
  const ChartTicks ticks = [&](double time_s) { return text.tick(time_s); };
  const auto figure = [&](const std::string& title, const std::string& chart) {
    return "<figure><figcaption>" + title + "</figcaption>" + chart + "</figure>\n";
  };
  const std::string unit = text.volume_unit();
  return "<div class=\"charts\">\n" +
         figure("Dug per " + text.every() + ", " + unit + ' ' + text.dug_soil(),
                bar_chart(cut, ends_s, ticks)) +
         figure("Production so far, " + unit, line_chart(std::move(lines), ends_s, ticks)) +
         "</div>\n";
}

std::string links_of(const Report& report, const std::string& token) {
  const auto to = [&](const char* path, const ReportQuery& query) {
    std::string address =
        fmt::format("{}?every={:.0f}&amp;units={}", path, query.every_s, query.units());
    if (query.from_s) address += fmt::format("&amp;from={}", *query.from_s);
    if (query.to_s) address += fmt::format("&amp;to={}", *query.to_s);
    return token.empty() ? address : address + "&amp;token=" + in_address(token);
  };
  const ReportQuery& now = report.query();
  const auto link = [&](const std::string& name, const char* path, const ReportQuery& query,
                        bool current = false) {
    return fmt::format("<a href=\"{}\"{}>{}</a>", to(path, query),
                       current ? " aria-current=\"true\"" : "", name);
  };
  std::string html = "<nav><span>Every";
  for (const auto& [name, every_s] :
       {std::pair("15 minutes", 900.0), {"hour", kHour_s}, {"day", kDay_s}}) {
    ReportQuery query = now;
    query.every_s = every_s;
    html += ' ' + link(name, "report", query, now.every_s == every_s);
  }
  html += "</span><span>Units";
  for (const bool us : {false, true}) {
    ReportQuery query = now;
    query.yards = query.short_tons = us;
    html += ' ' + link(us ? "yd³, short tons" : "m³, t", "report", query,
                       now.yards == us && now.short_tons == us);
  }
  if (report.has_mass()) {
    using Soil = ReportQuery::Soil;
    html += "</span><span>Volumes";
    for (const auto& [name, soil] : {std::pair("as counted", Soil::kCounted),
                                     {"bank", Soil::kBank},
                                     {"loose", Soil::kLoose}}) {
      ReportQuery query = now;
      query.soil = soil;
      html += ' ' + link(name, "report", query, now.soil == soil);
    }
  }
  html += "</span><span>" + link("CSV", "report.csv", now) + " <a href=\"./#units=" + now.units() +
          (token.empty() ? "" : "&amp;token=" + in_address(token)) +
          "\">Live page</a></span></nav>\n";
  return html;
}

std::string notes_of(const Report& report) {
  std::string html =
      "<footer><p>Dug is soil taken out of the ground, counted in place as bank soil, also where "
      "it was loose. Put down is what left the buckets, counted as loose soil";
  if (report.has_hoppers()) html += "; hauled is the part that hoppers received";
  html += ". ";
  if (report.query().soil != ReportQuery::Soil::kCounted)
    html += fmt::format("Volumes are shown as {} soil; 1 of bank is {:.4g} of loose. ",
                        report.soil_of(ReportQuery::Soil::kBank), report.loose_per_bank());
  if (report.has_mass()) html += "Load is the mass that buckets took up. ";
  html += fmt::format(
      "Load factor is the mean load per cycle over the struck capacity. A machine works until "
      "{:.0f} "
      "s after it last moved, and is then idle; silence of over {:.0f} s counts as neither. Seen "
      "is "
      "from its first to its last state. A dash: not known, or nothing.</p><p>Made by soilvdb, {} "
      "UTC.</p></footer>",
      kIdleAfter_s, kSilentAfter_s,
      ReportText::date(static_cast<double>(std::time(nullptr)), "{:%d %B %Y, %H:%M}"));
  return html;
}

}  // namespace

std::string report_page(const Report& report, const std::string& token) {
  const ReportText text(report);
  const std::string site = io::markup_text(report.site());
  const std::vector<Report::Period>& periods = report.periods();
  std::string html = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width, initial-scale=1\"><title>Report of {0}</title><style>{1}"
      "</style></head><body>\n<header><h1>{0}</h1><p>Report of earthworks{2}</p></header>\n",
      site, kReportStyle,
      periods.empty() ? "" : ", " + text.whole_time() + ", every " + text.every());
  html += links_of(report, token);
  html += sums_of(report, text);
  if (periods.empty()) html += "<p>There are no states with times yet.</p>\n";
  if (!periods.empty()) html += charts_of(report, text);
  html += progress_html(
      report, [&](double time_s) { return text.time(time_s, true); },
      [&](double time_s) { return text.moment(time_s); }, text.volume_unit());
  std::vector<ReportLine> lines;
  for (std::size_t i = 0; i < report.names().size(); ++i)
    lines.push_back({report.names()[i], &report.total(), i});
  html += "<h2>Machines</h2>\n" +
          table_of(report, text, "Machine", lines, {"All machines", &report.total(), {}});
  for (std::size_t i = 0; i < report.names().size(); ++i) {
    lines.clear();
    for (const Report::Period& period : periods)
      if (period.machines[i].first_s) lines.push_back({text.period(period), &period, i});
    if (lines.empty()) continue;
    html += "<h2>" + io::markup_text(report.names()[i]) + "</h2>\n" +
            table_of(report, text, "Period", lines, {"Total", &report.total(), i});
  }
  return html + notes_of(report) + "</body></html>\n";
}

}  // namespace soilvdb::tools
