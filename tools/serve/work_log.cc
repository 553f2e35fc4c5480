// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/work_log.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "io/file/json.h"
#include "io/file/text.h"
#include "soilvdb/capacity.h"
#include "soilvdb/site.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

double struck_m3(const Bucket& bucket) {
  const auto capacity = Capacity::of(bucket);
  return capacity ? capacity->struck_m3() : 0;
}

Json machine_state(const Session& site, std::size_t i, const WorkLog::Machine& work, bool works,
                   const std::optional<Estimate>& lip_m) {
  const SiteMachine& machine = site.machines()[i];
  const Ledger& ledger = site.ledger(i);
  const std::optional<double> last_m3 = work.cycles.last_load_m3();
  Json json = {
      {"name", machine.name},
      {"position", nullptr},
      {"rotation", nullptr},
      {"links", Json::array()},
      {"bucket_m3", ledger.bucket_m3()},
      {"bucket_kg", site.earthmoving().soil ? Json(site.bucket_kg(i)) : Json()},
      {"fill", work.capacity_m3 > 0 ? Json(ledger.bucket_m3() / work.capacity_m3) : Json()},
      {"cut_m3", ledger.cut_m3()},
      {"cycles", work.cycles.cycles()},
      {"last_load_m3", last_m3 ? Json(*last_m3) : Json()},
      {"lip_error_m", lip_m ? Json{{"mean", lip_m->mean}, {"sigma", lip_m->sigma}} : Json()},
      {"state", "unseen"}};
  const std::optional<MachineState> last = site.last(i);
  if (!last) return json;
  json["position"] = io::numbers(last->pose.position);
  json["rotation"] = io::numbers(last->pose.rotation.coeffs());
  if (!last->joints.empty())
    for (const Vec3& place : machine.chain->joint_places(configuration_of(*last)))
      json["links"].push_back(io::numbers(place));
  json["state"] = works ? "working" : "idle";
  return json;
}

/// Noise of sensors on a machine that stands: positions err by some millimetres, angles by a
/// degree.
constexpr double kStands_m = 0.03, kStands_rad = 0.03, kStandsJoint = 0.01;

/// @param joints number of the machine's joints
bool has_left(const WorkLog::Place& from, const WorkLog::Place& to, std::size_t joints) {
  const std::vector<double>&a = from.numbers, &b = to.numbers;
  if (from.joints != to.joints || a.size() != b.size()) return true;
  if (!to.joints) joints = 0;
  for (std::size_t i = 0; i < joints; ++i)
    if (std::abs(b[i] - a[i]) > kStandsJoint) return true;
  if (a.size() != joints + kPoseNumbers) return false;  // its base stands
  const Pose was = pose_of(&a[joints]), is = pose_of(&b[joints]);
  return (is.position - was.position).norm() > kStands_m ||
         std::abs(is.rotation.dot(was.rotation)) < std::cos(kStands_rad / 2);
}

/// Of a load, sticky soil may stay.
constexpr double kMayStay = 0.4;

}  // namespace

void CycleCounter::add(double load_m3, bool cuts) {
  if (emptying_) {
    trough_m3_ = std::min(trough_m3_, load_m3);
    if (load_m3 >= trough_m3_ + std::max(least_m3_, peak_m3_ / 4)) {
      emptying_ = false;  // the next load; or this one, which was only shaken in the ground
      peak_m3_ = load_m3;
    }
  }
  peak_m3_ = std::max(peak_m3_, load_m3);
  largest_m3_ = std::max(largest_m3_, load_m3);
  if (!emptying_) {
    if (!(peak_m3_ > least_m3_) || load_m3 > kMayStay * peak_m3_) return;
    trough_m3_ = load_m3;
    emptying_ = true;
    counted_ = false;
  }
  if (cuts || counted_) return;
  ++cycles_;
  last_m3_ = std::exchange(largest_m3_, 0);
  counted_ = true;
}

WorkLog::WorkLog(const Session& site)
    : loose_m3_(site.site().ground->sample_m3() /
                static_cast<double>(
                    site.earthmoving().soil ? MassUnits(*site.earthmoving().soil).loose : 1)) {
  follow(site);
}

void WorkLog::follow(const Session& site) {
  hauls_from_s_.reset();
  for (const Hopper& hopper : site.earthmoving().hoppers)
    hauls_from_s_ = std::min(hauls_from_s_.value_or(hopper.begin_s), hopper.begin_s);
  for (std::size_t i = machines_.size(); i < site.machines().size(); ++i) {
    const Bucket& bucket = site.machines()[i].bucket;
    Machine& work = machines_.emplace_back();
    work.capacity_m3 = struck_m3(bucket);
    if (const auto& chain = site.machines()[i].chain) work.joints = chain->movable_count();
    const double about_m3 = work.capacity_m3 > 0
                                ? work.capacity_m3
                                : bucket.width_m * bucket.height_m * bucket.height_m;
    work.cycles = CycleCounter(about_m3 / 4);  // a blade always pushes some soil
  }
}

void WorkLog::note_time(double time_s) {
  if (!from_s_) from_s_ = time_s;
  time_s_ = std::max(time_s_, std::optional(time_s));
}

bool WorkLog::add(std::size_t machine, std::optional<double> time_s, Place at, const Soil& soil) {
  const bool moved = has_left(machines_[machine].stood, at, machines_[machine].joints);
  if (moved) machines_[machine].stood = std::move(at);
  add(machine, time_s, moved, soil);
  return moved;
}

void WorkLog::add(std::size_t machine, std::optional<double> time_s, bool moved, const Soil& soil) {
  Machine& work = machines_[machine];
  const std::optional<double> before_s = work.time_s;
  if (time_s) {
    if (work.clock_is_set) {
      if (from_s_) from_s_ = std::min(*from_s_, *time_s);
      work.minutes.end_at(*time_s);
    }
    note_time(*time_s);
    work.time_s = time_s;
    work.clock_is_set = false;
    add_time(work, before_s, *time_s, moved);
  }
  const std::int64_t cycles = work.cycles.cycles();
  work.cycles.add(static_cast<double>(soil.load) * loose_m3_, soil.cut > 0);
  Work made{.cut = soil.cut,
            .loaded = soil.load - std::exchange(work.load, soil.load) + soil.put_down,
            .put_down = soil.put_down,
            .hauled = soil.hauled,
            .cycles = work.cycles.cycles() - cycles};
  if (made.cycles > 0) made.cycle_loads_m3 = work.cycles.last_load_m3().value_or(0);
  if (time_s) made.add_state(*time_s);
  (time_s_ ? work.minutes.at(time_s.value_or(*time_s_)) : work.untimed) += made;
  if (moved && time_s_) work.moved_s = time_s_;
}

/// The time since a machine's last state: it works up to some seconds after it moved.
void WorkLog::add_time(Machine& work, std::optional<double> before_s, double time_s, bool moved) {
  if (!before_s || time_s - *before_s > kSilentAfter_s) return;
  const double stops_s =
      moved ? time_s
            : std::clamp(work.moved_s.value_or(*before_s) + kIdleAfter_s, *before_s, time_s);
  work.minutes.spread(*before_s, stops_s, &Work::working_s);
  work.minutes.spread(stops_s, time_s, &Work::idle_s);
}

void WorkLog::set_clock(std::size_t machine) {
  machines_[machine].time_s.reset();
  machines_[machine].clock_is_set = true;
  time_s_.reset();
  for (const Machine& other : machines_) time_s_ = std::max(time_s_, other.time_s);
  // A machine's last move before its clock was set precedes all later times.
  for (Machine& other : machines_) other.moved_s = std::min(other.moved_s, time_s_);
}

/// A machine stands while its rows hardly change.
void WorkLog::add(const io::JournalUpdate& update) {
  using Kind = io::JournalUpdate::Kind;
  const bool of_machine = update.machine < machines_.size();
  if (update.kind == Kind::kClock && of_machine) set_clock(update.machine);
  if (std::isfinite(update.begin_s)) note_time(update.begin_s);
  if (std::isfinite(update.end_s)) note_time(update.end_s);
  if (update.kind == Kind::kSurvey)
    Site::is_of_scans(io::unpack_survey(update.survey)) ? note_scan() : note_survey();
  if (!update.has_rows() || !of_machine) return;
  const io::MotionRows& rows = update.rows;
  Machine& work = machines_[update.machine];
  bool moved = false;  // on the way to the last row
  for (std::size_t i = 0; i < rows.values.size(); i += rows.columns) {
    const auto row = rows.values.begin() + static_cast<std::ptrdiff_t>(i);
    Place at = {{row, row + static_cast<std::ptrdiff_t>(rows.columns)}, rows.joints};
    if (!has_left(work.stood, at, work.joints)) continue;
    work.stood = std::move(at);
    moved = true;
  }
  const bool has_time = std::isfinite(update.end_s);
  if (!work.time_s && std::isfinite(update.begin_s)) work.time_s = update.begin_s;
  const bool all_known = !hauls_from_s_ || update.end_s < *hauls_from_s_ || update.spilled == 0;
  add(update.machine, has_time ? std::optional(update.end_s) : std::nullopt, moved,
      {update.cut_samples, update.bucket_samples, update.spilled,
       update.hauled || !all_known ? update.hauled : 0});
}

bool WorkLog::works(std::size_t machine) const {
  const std::optional<double>& moved_s = machines_[machine].moved_s;
  return moved_s && time_s_ && *time_s_ - *moved_s < kIdleAfter_s;
}

Json site_state(const Session& site, const WorkLog& log, const std::vector<bool>& works) {
  Json machines = Json::array();
  const std::vector<Estimate> lips_m = site.lip_errors_m();
  for (std::size_t i = 0; i < works.size(); ++i)
    if (!site.is_retired(i))
      machines.push_back(
          machine_state(site, i, log.machines()[i], works[i],
                        i < lips_m.size() ? std::optional(lips_m[i]) : std::nullopt));
  const Ledger total = site.total();
  const MassBalance balance = site.mass_balance_without_ground();
  const double sample_m3 = site.site().ground->sample_m3();
  const std::optional<Surveyed> surveyed = site.surveyed();
  const std::int64_t added = surveyed ? surveyed->added - surveyed->removed : 0;
  const std::int64_t change = balance.fill_samples - balance.failed_samples - total.cut() + added;
  return {{"type", "state"},
          {"time_s", log.time_s() ? Json(*log.time_s()) : Json()},
          {"machines", machines},
          {"cut_m3", total.cut_m3()},
          {"spilled_m3", total.spilled_m3()},
          {"fill_m3", static_cast<double>(balance.fill_samples) * sample_m3},
          {"scanned_s", log.scanned_s() ? Json(*log.scanned_s()) : Json()},
          {"surveyed_m3", surveyed ? Json(static_cast<double>(added) * sample_m3) : Json()},
          {"change_m3", static_cast<double>(change) * sample_m3}};
}

Json site_state(const Session& site, const WorkLog& log) {
  std::vector<bool> works;
  for (std::size_t i = 0; i < log.machines().size(); ++i) works.push_back(log.works(i));
  return site_state(site, log, works);
}

std::string machines_csv(const Json& state) {
  std::string csv = "machine,state,x_m,y_m,z_m,bucket_m3,bucket_kg,cut_m3,cycles,last_load_m3\n";
  for (const Json& json : state["machines"]) {
    const auto cell = [](const Json& value) {
      return value.is_null() ? std::string() : io::to_text(value);
    };
    const Json& at = json["position"];
    csv += fmt::format(
        "{},{},{},{},{},{},{},{},{},{}\n", io::csv_field(json["name"].get<std::string>()),
        json["state"].get<std::string>(), at.is_null() ? "" : io::to_text(at[0]),
        at.is_null() ? "" : io::to_text(at[1]), at.is_null() ? "" : io::to_text(at[2]),
        cell(json["bucket_m3"]), cell(json["bucket_kg"]), cell(json["cut_m3"]),
        cell(json["cycles"]), cell(json["last_load_m3"]));
  }
  return csv;
}

}  // namespace soilvdb::tools
