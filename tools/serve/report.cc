// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/report.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "io/file/text.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

constexpr double kYard_m3 = 0.764554857984, kShortTon_kg = 907.18474, kTonne_kg = 1000;
constexpr double kMostEvery_s = 366 * 86400.0;
constexpr std::int64_t kMostPeriods = 10'000;

double seconds(std::int64_t minute) { return static_cast<double>(minute) * WorkMinutes::kMinute_s; }

std::int64_t floor_to_multiple(std::int64_t value, std::int64_t of) {
  const std::int64_t rest = value % of;
  return value - (rest < 0 ? rest + of : rest);
}

std::int64_t whole_minutes_up(double time_s) {
  const std::int64_t minute = WorkMinutes::minute_of(time_s);
  return seconds(minute) < time_s ? minute + 1 : minute;
}

/// Words of `units=` by what they are of; the same words as in tools/view/src/units.js.
constexpr std::array<std::array<std::string_view, 3>, 4> kUnitWords = {
    {{"m", "ft", "us_ft"}, {"m3", "yd3"}, {"t", "short_tons"}, {"counted", "bank", "loose"}}};

void set_units(ReportQuery& query, const std::string& words) {
  std::array<std::string, kUnitWords.size()> chosen;
  for (std::size_t at = 0; at <= words.size();) {
    const std::size_t end = std::min(words.find(',', at), words.size());
    const std::string word = words.substr(at, end - at);
    std::size_t kind = 0;
    const auto has = [&](const auto& known) {
      return std::find(known.begin(), known.end(), word) != known.end();
    };
    while (kind < kUnitWords.size() && !has(kUnitWords[kind])) ++kind;
    if (word.empty() || kind == kUnitWords.size() || !chosen[kind].empty())
      throw std::invalid_argument(
          "'units' must be at most one each of m3 and yd3, of t and short_tons, of counted, bank "
          "and loose, and of m, ft and us_ft, such as units=yd3,short_tons,loose");
    chosen[kind] = word;
    at = end + 1;
  }
  using Soil = ReportQuery::Soil;
  query.length = chosen[0];
  query.yards = chosen[1] == "yd3";
  query.short_tons = chosen[2] == "short_tons";
  query.soil = chosen[3] == "bank"    ? Soil::kBank
               : chosen[3] == "loose" ? Soil::kLoose
                                      : Soil::kCounted;
}

std::string or_nothing(const std::optional<double>& value) {
  return value ? fmt::format("{}", *value) : std::string();
}

}  // namespace

ReportQuery::ReportQuery(const QueryParameters& parameters)
    : from_s(parameters.time_if("from")),
      to_s(parameters.time_if("to")),
      every_s(parameters.number_if("every").value_or(3600)) {
  if (!(every_s >= WorkMinutes::kMinute_s && every_s <= kMostEvery_s &&
        std::fmod(every_s, WorkMinutes::kMinute_s) == 0))
    throw std::invalid_argument(fmt::format(
        "'every' must be whole minutes in seconds, 60 to {:.0f}, such as 3600 for an hour, and {} "
        "is not",
        kMostEvery_s, every_s));
  if (from_s && to_s && !(*from_s < *to_s))
    throw std::invalid_argument(
        fmt::format("'from' must be before 'to', and {} s is not before {} s", time_text(*from_s),
                    time_text(*to_s)));
  if (const std::string words = parameters.text_if("units"); !words.empty())
    set_units(*this, words);
}

std::string ReportQuery::units() const {
  return (length.empty() ? "" : length + ',') + (yards ? "yd3," : "m3,") +
         (short_tons ? "short_tons" : "t") +
         (soil == Soil::kBank    ? ",bank"
          : soil == Soil::kLoose ? ",loose"
                                 : "");
}

Report::Report(const LiveSite& site, ReportQuery query)
    : site_(site.name()),
      log_(site.log()),
      query_(std::move(query)),
      soil_(site.session().earthmoving().soil),
      sample_m3_(site.session().site().ground->sample_m3()),
      has_hoppers_(!site.session().earthmoving().hoppers.empty()) {
  if (soil_) units_ = MassUnits(*soil_);
  if (!soil_ && query_.soil != ReportQuery::Soil::kCounted)
    throw std::invalid_argument(
        "'units' may have bank or loose only if the scenario has 'soil', whose 'swell' is between "
        "them");
  for (const SiteMachine& machine : site.session().machines()) names_.push_back(machine.name);
}

Work Report::Period::all() const {
  Work sum;
  for (const Work& work : machines) sum += work;
  return sum;
}

/// The minutes of the report; empty if there is no work yet.
std::optional<Report::Range> Report::range() const {
  std::optional<Range> known;
  for (const WorkLog::Machine& machine : log_.machines()) {
    const auto first = machine.minutes.first(), last = machine.minutes.last();
    if (!first) continue;
    known = known ? Range{std::min(known->from, *first), std::max(known->to, *last + 1)}
                  : Range{*first, *last + 1};
  }
  if (!known) return {};
  if (query_.from_s && *query_.from_s >= seconds(known->to))
    throw std::invalid_argument(
        fmt::format("'from' must be a time that is recorded, and {} s is later than {} s",
                    time_text(*query_.from_s), time_text(log_.time_s().value_or(0))));
  if (query_.to_s && *query_.to_s <= seconds(known->from))
    throw std::invalid_argument(
        fmt::format("'to' must be a time that is recorded, and {} s is before {} s",
                    time_text(*query_.to_s), time_text(log_.from_s().value_or(0))));
  const auto every = static_cast<std::int64_t>(query_.every_s / WorkMinutes::kMinute_s);
  Range range = {floor_to_multiple(known->from, every),
                 floor_to_multiple(known->to - 1, every) + every};
  if (query_.from_s) range.from = std::max(range.from, WorkMinutes::minute_of(*query_.from_s));
  if (query_.to_s) range.to = std::min(range.to, whole_minutes_up(*query_.to_s));
  return range;
}

void Report::sum() {
  const std::size_t count = names_.size();
  total_ = {0, 0, std::vector<Work>(count)};
  const auto add_untimed = [&](Period& to) {
    for (std::size_t i = 0; i < count; ++i) to.machines[i] += log_.machines()[i].untimed;
  };
  const std::optional<Range> all = range();
  if (!all) return add_untimed(total_);
  const auto every = static_cast<std::int64_t>(query_.every_s / WorkMinutes::kMinute_s);
  const std::int64_t first = floor_to_multiple(all->from, every);
  const std::int64_t periods = (all->to - first + every - 1) / every;
  if (periods > kMostPeriods)
    throw std::invalid_argument(fmt::format(
        "{} periods are too many; at most {}: every={:.0f}, or 'from' and 'to' closer together",
        periods, kMostPeriods,
        60 * std::ceil(seconds(all->to - first) / 60 / static_cast<double>(kMostPeriods - 1))));
  for (std::int64_t k = 0; k < periods; ++k)
    periods_.push_back({seconds(std::max(first + k * every, all->from)),
                        seconds(std::min(first + (k + 1) * every, all->to)),
                        std::vector<Work>(count)});
  bool from_begin = true;
  for (std::size_t i = 0; i < count; ++i) {
    const WorkMinutes& minutes = log_.machines()[i].minutes;
    if (const auto begin = minutes.first()) from_begin = from_begin && all->from <= *begin;
    minutes.visit(all->from, all->to, [&](std::int64_t minute, const Work& work) {
      periods_[static_cast<std::size_t>((minute - first) / every)].machines[i] += work;
    });
  }
  if (from_begin) add_untimed(periods_.front());
  total_.from_s = periods_.front().from_s;
  total_.to_s = periods_.back().to_s;
  for (const Period& period : periods_)
    for (std::size_t i = 0; i < count; ++i) total_.machines[i] += period.machines[i];
}

double Report::in_volume_unit(double m3) const { return query_.yards ? m3 / kYard_m3 : m3; }

Report::Row Report::row(const Period& period, std::optional<std::size_t> machine) const {
  const Work work = machine ? period.machines[*machine] : period.all();
  const auto loose = [&](std::int64_t mass) {
    return volume(units_.loose_samples(mass) * sample_m3_, ReportQuery::Soil::kLoose);
  };
  Row row{volume(static_cast<double>(work.cut) * sample_m3_, ReportQuery::Soil::kBank),
          loose(work.put_down),
          {},
          {},
          {}};
  if (work.hauled) row.hauled = loose(*work.hauled);
  if (soil_)
    row.load =
        units_.kg(work.loaded, sample_m3_, *soil_) / (query_.short_tons ? kShortTon_kg : kTonne_kg);
  double loads_m3 = 0, capacity_m3 = 0;
  for (std::size_t i = 0; i < period.machines.size(); ++i) {
    const double struck_m3 = log_.machines()[i].capacity_m3;
    if ((machine && *machine != i) || struck_m3 <= 0) continue;
    loads_m3 += period.machines[i].cycle_loads_m3;
    capacity_m3 += static_cast<double>(period.machines[i].cycles) * struck_m3;
  }
  if (capacity_m3 > 0) row.load_factor = loads_m3 / capacity_m3;
  return row;
}

double Report::volume(double m3, ReportQuery::Soil counted) const {
  if (query_.soil != ReportQuery::Soil::kCounted && query_.soil != counted)
    m3 = query_.soil == ReportQuery::Soil::kLoose ? m3 * loose_per_bank() : m3 / loose_per_bank();
  return in_volume_unit(m3);
}

const char* Report::soil_of(ReportQuery::Soil counted) const {
  const ReportQuery::Soil soil = query_.soil == ReportQuery::Soil::kCounted ? counted : query_.soil;
  return soil == ReportQuery::Soil::kBank ? "bank" : "loose";
}

bool Report::has_dates() const { return total_.from_s >= kLeastEpoch_s; }

std::string utc_text(double time_s) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}",
                     fmt::gmtime(static_cast<std::time_t>(std::floor(time_s))));
}

std::string report_csv(const Report& report) {
  const char* volume = report.volume_unit();
  std::string csv = fmt::format(
      "machine,span,from_s,to_s,from_utc,to_utc,cut_{0}_{1},put_down_{0}_{2},hauled_{0}_{2},"
      "load_{3},cycles,load_factor,working_s,idle_s,first_state_s,last_state_s\n",
      volume, report.soil_of(ReportQuery::Soil::kBank), report.soil_of(ReportQuery::Soil::kLoose),
      report.mass_unit());
  const auto utc = [](double time_s) {
    return time_s >= kLeastEpoch_s ? utc_text(time_s) : std::string();
  };
  const auto add = [&](const std::string& name, const char* span, const Report::Period& period,
                       std::optional<std::size_t> machine) {
    const Work work = machine ? period.machines[*machine] : period.all();
    const Report::Row row = report.row(period, machine);
    csv += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", io::csv_field(name),
                       span, time_text(period.from_s), time_text(period.to_s), utc(period.from_s),
                       utc(period.to_s), row.cut, row.put_down, or_nothing(row.hauled),
                       or_nothing(row.load), work.cycles, or_nothing(row.load_factor),
                       time_text(work.working_s), time_text(work.idle_s), or_nothing(work.first_s),
                       or_nothing(work.last_s));
  };
  const auto add_all = [&](const char* span, const Report::Period& period) {
    for (std::size_t i = 0; i < report.names().size(); ++i) add(report.names()[i], span, period, i);
    add("all", span, period, {});
  };
  for (const Report::Period& period : report.periods()) add_all("period", period);
  add_all("total", report.total());
  return csv;
}

}  // namespace soilvdb::tools
