// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/progress.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace soilvdb::tools {
namespace {

using ProgressJson = nlohmann::ordered_json;

/// Apart so that coarser ones are among finer ones: what was looked at is looked at once.
constexpr double kSteps_s[] = {1,    5,        15,    60,        300,        900,
                               3600, 4 * 3600, 86400, 7 * 86400, 28 * 86400, 364 * 86400};
constexpr double kMostSamples = 60, kMostDugAgain = 12, kMostDugAgain_s = 600;
constexpr std::size_t kMostKept = 100'000;
constexpr double kHourOfWork_s = 3600, kDayOfWork_s = 86400;
/// The rate is that of so much work; more would tell of other days, less of a few loads.
constexpr double kRateOver_h = 4;
/// Less work has no rate, or no end: a load more or less would change it by a lot.
constexpr double kLeastRate_h = 1 / 60.0, kLeastEnd_h = 0.5;
constexpr double kMostDays = 7, kFarthestEnd_s = 5 * 365 * kDayOfWork_s;
/// Mean of what is left where the design is reached, as surveys of earthworks know it.
constexpr double kReached_m = 0.01;

/// Step of the finest grid with so many times at most.
double step_of(double span_s, double most) {
  for (const double step_s : kSteps_s)
    if (span_s / step_s <= most) return step_s;
  return kSteps_s[std::size(kSteps_s) - 1];
}

/// Times of earlier grounds: of snapshots, and of few others, because they are dug again.
/// @param known_s an update at the last recorded time may be followed by others of that time
std::vector<double> times_between(double from_s, double to_s, double known_s,
                                  const std::vector<double>& snapshots_s) {
  const double step_s = step_of(to_s - from_s, kMostSamples);
  const double dug_step_s = step_of(to_s - from_s, kMostDugAgain);
  std::vector<double> times_s;
  if (from_s < std::min(to_s, known_s))
    times_s.push_back(from_s);  // states without a time were before
  for (double k = std::floor(from_s / step_s) + 1; k * step_s < std::min(to_s, known_s); ++k) {
    const double time_s = k * step_s;
    const auto later = std::upper_bound(snapshots_s.begin(), snapshots_s.end(), time_s);
    const double before_s =
        later == snapshots_s.begin() ? from_s : std::max(from_s, *std::prev(later));
    if (before_s > time_s - step_s && before_s > from_s)
      times_s.push_back(before_s);
    else if (std::fmod(time_s, dug_step_s) == 0 && time_s - before_s <= kMostDugAgain_s)
      times_s.push_back(time_s);
  }
  return times_s;
}

Remaining of_design(const ToDesign& left) { return {left.cut_m3, left.fill_m3}; }

std::string hours_text(double hours) {
  return hours < 1 ? fmt::format("{:.0f} min", 60 * hours) : fmt::format("{:.2g} h", hours);
}

}  // namespace

ProgressQuery::ProgressQuery(const LiveSite& site, std::vector<Measure> areas,
                             std::shared_ptr<const InitialTerrain> design)
    : areas_(std::move(areas)),
      design_(std::move(design)),
      from_s_(site.from_s()),
      changes_(site.changes_of_past()) {
  if (!design_)
    throw std::invalid_argument("there is no design; soilvdb serve takes one by --design");
  to_s_ = site.time_s();
  known_s_ = site.recorded() ? site.session().acknowledged().time_s : to_s_.value_or(0);
}

std::optional<Remaining> ProgressQuery::remaining(GroundQuery& ground, const Measure& area) const {
  const BoundaryVolume inside = ground.inside(area.points);
  if (!inside.to_design || inside.to_design->area_m2 == 0) return {};
  return of_design(*inside.to_design);
}

bool ProgressQuery::step(History& history, ProgressSamples& samples, std::uint64_t changes) {
  const bool changed = std::exchange(samples.changes, changes) != changes;
  if (changed || samples.at.size() > kMostKept) samples.at.clear();
  if (std::exchange(changes_, changes) != changes) planned_ = false;
  if (!std::exchange(planned_, true)) {
    found_.clear();
    earlier_s_.clear();
    if (from_s_ && to_s_)
      earlier_s_ = times_between(*from_s_, *to_s_, known_s_, history.times().snapshots_s);
  }
  bool looked = false;
  for (const double time_s : earlier_s_) {
    std::optional<GroundQuery> ground;
    for (const Measure& area : areas_) {
      const std::pair key(time_s, area.shape);
      if (found_.contains(key)) continue;
      const auto known = samples.at.find(key);
      if (known != samples.at.end()) {
        found_.insert(*known);
        continue;
      }
      if (!ground) {
        if (looked) return true;
        ground.emplace(Past{history.ground_at(time_s), nullptr}, nullptr, design_);
        looked = true;
      }
      try {
        samples.at[key] = found_[key] = remaining(*ground, area).value_or(Remaining());
      } catch (const std::invalid_argument&) {  // finish() tells it
        found_[key] = {};
      }
    }
  }
  return false;
}

void ProgressQuery::take_work(const LiveSite& site) {
  log_ = site.log();
  to_s_ = site.time_s();
}

void ProgressQuery::finish(GroundQuery& live) {
  for (const Measure& area : areas_) {
    Progress progress{area.id, area.name};
    try {
      const std::optional<Remaining> now = remaining(live, area);
      const BoundaryVolume undug = live.inside_undug(area.points);
      if (now) {
        progress.now = *now;
        progress.start = of_design(*undug.to_design);
        if (from_s_ && to_s_) {
          if (earlier_s_.empty()) {
            progress.times_s.push_back(*from_s_);
            progress.at.push_back(progress.start);
          }
          for (const double time_s : earlier_s_) {
            progress.times_s.push_back(time_s);
            progress.at.push_back(found_[{time_s, area.shape}]);
          }
          progress.times_s.push_back(*to_s_);
          progress.at.push_back(progress.now);
        }
        sum(progress, undug.to_design->area_m2);
      } else {
        progress.why_nothing = "the design has no heights in this area";
      }
    } catch (const std::invalid_argument& e) {
      progress.why_nothing = e.what();
    }
    result_.push_back(std::move(progress));
  }
}

double ProgressQuery::worked_h(double from_s, double to_s) const {
  std::map<std::int64_t, double> worked_s;  // by minute, of the machine that worked most
  const std::int64_t last = WorkMinutes::minute_of(to_s) + 1;
  for (const WorkLog::Machine& machine : log_->machines())
    machine.minutes.visit(WorkMinutes::minute_of(from_s), last,
                          [&](std::int64_t minute, const Work& work) {
                            double& most_s = worked_s[minute];
                            most_s = std::max(most_s, work.working_s);
                          });
  double sum_s = 0;
  for (const auto& [minute, in_minute_s] : worked_s) {
    const double begin_s = static_cast<double>(minute) * WorkMinutes::kMinute_s;
    const double end_s = begin_s + WorkMinutes::kMinute_s;
    const double known_s = std::min(end_s, *to_s_) - std::max(begin_s, *from_s_);
    const double part_s = std::min(end_s, to_s) - std::max(begin_s, from_s);
    if (known_s > 0) sum_s += in_minute_s * std::clamp(part_s / known_s, 0.0, 1.0);
  }
  return sum_s / kHourOfWork_s;
}

/// Rate and end.
void ProgressQuery::sum(Progress& progress, double area_m2) const {
  const double left_m3 = progress.now.all_m3(), start_m3 = progress.start.all_m3();
  if (start_m3 > 0) progress.done = 1 - left_m3 / start_m3;
  if (progress.times_s.empty()) {
    progress.note = "no state had a time yet, so there is no rate";
    return;
  }
  const double now_s = progress.times_s.back();
  std::size_t since = progress.times_s.size() - 1;
  const std::optional<double> surveyed_s = log_->surveyed_s();
  const auto is_work = [&](double time_s) { return !surveyed_s || time_s >= *surveyed_s; };
  while (since > 0 && progress.over_h < kRateOver_h && is_work(progress.times_s[since - 1]))
    progress.over_h = worked_h(progress.times_s[--since], now_s);
  const std::string over = hours_text(progress.over_h);
  if (progress.over_h >= kLeastRate_h)
    progress.per_h = (progress.at[since].all_m3() - left_m3) / progress.over_h;
  if (left_m3 <= kReached_m * area_m2) {
    progress.note =
        fmt::format("the design is reached, within {:.0f} cm on average", 100 * kReached_m);
    return;
  }
  if (!progress.per_h) {
    progress.note = fmt::format("machines have worked less than a minute{}",
                                surveyed_s ? " since the last survey" : "");
    return;
  }
  if (*progress.per_h <= 0) {
    progress.note = fmt::format("what is left has not become less in the last {} of work", over);
    return;
  }
  if (progress.over_h < kLeastEnd_h) {
    progress.note = fmt::format("{} of work is too little to tell the end; {} is needed", over,
                                hours_text(kLeastEnd_h));
    return;
  }
  progress.left_h = left_m3 / *progress.per_h;
  const double days = std::min(kMostDays, std::floor((now_s - *from_s_) / kDayOfWork_s));
  double share = 1;
  if (days >= 1) {
    const double worked = worked_h(now_s - days * kDayOfWork_s, now_s);
    share = worked / (24 * days);
    if (share <= 0) {
      progress.note = fmt::format("no machine has worked in the last {:.0f} days", days);
      return;
    }
    progress.note =
        days < 2 ? fmt::format("if {:.1f} h of each day are worked, as in the last 24 h", worked)
                 : fmt::format("if {:.1f} h of each day are worked, as in the last {:.0f} days",
                               worked / days, days);
  } else if (*progress.left_h <= 24) {
    progress.note = "if work goes on without a break";
  } else {
    progress.note = "hours of work per day are known after a day";
    return;
  }
  const double after_s = *progress.left_h * kHourOfWork_s / share;
  if (after_s > kFarthestEnd_s)
    progress.note = "at this rate it takes more than five years";
  else
    progress.end_s = now_s + after_s;
}

ProgressJson progress_json(const std::vector<Progress>& all) {
  const auto or_null = [](const std::optional<double>& value) {
    return value ? ProgressJson(*value) : ProgressJson();
  };
  ProgressJson areas = ProgressJson::array();
  for (const Progress& of : all) {
    ProgressJson area = {{"id", of.measure}, {"name", of.name}};
    if (!of.why_nothing.empty()) {
      area["error"] = of.why_nothing;
      areas.push_back(area);
      continue;
    }
    ProgressJson times_s = ProgressJson::array(), cut = times_s, fill = times_s;
    for (std::size_t i = 0; i < of.times_s.size(); ++i) {
      times_s.push_back(of.times_s[i]);
      cut.push_back(of.at[i].cut_m3);
      fill.push_back(of.at[i].fill_m3);
    }
    area["to_cut_m3"] = of.now.cut_m3;
    area["to_fill_m3"] = of.now.fill_m3;
    area["at_start"] = {{"to_cut_m3", of.start.cut_m3}, {"to_fill_m3", of.start.fill_m3}};
    area["done"] = or_null(of.done);
    area["rate_m3_per_h"] = or_null(of.per_h);
    area["rate_over_h"] = of.over_h;
    area["left_h"] = or_null(of.left_h);
    area["end_s"] = or_null(of.end_s);
    area["note"] = of.note;
    area["over_time"] = {{"time_s", times_s}, {"to_cut_m3", cut}, {"to_fill_m3", fill}};
    areas.push_back(area);
  }
  return {{"areas", areas}};
}

}  // namespace soilvdb::tools
