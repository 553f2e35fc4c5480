// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/live_site.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "io/file/text.h"
#include "soilvdb/capacity.h"
#include "tools/run/run_folder.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
/// A machine that hasn't moved for so long is idle.
constexpr std::chrono::seconds kIdleAfter{10};
/// Farthest from one state to the next.
constexpr double kFarthest_m = 100;
/// Latest time, beyond any calendar's: after a slip no state of that machine would be taken.
constexpr double kMostTime_s = 1e10;
/// Rotations in JSON are often rounded; those that are off by more aren't taken.
constexpr double kUnitTolerance = 1e-3;

Json numbers(const auto& values) {
  Json all = Json::array();
  for (const double value : values) all.push_back(value);
  return all;
}

Json or_null(double value) { return std::isfinite(value) ? Json(value) : Json(); }

std::string line_of(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

double number(const Json& json, const std::string& what) {
  if (!json.is_number()) throw std::invalid_argument(what + " must be a number");
  return json.get<double>();
}

template <std::size_t N>
std::array<double, N> array_of(const Json& json, const std::string& what) {
  std::array<double, N> all{};
  if (!json.is_array() || json.size() != N)
    throw std::invalid_argument(fmt::format("'{}' must be an array of {} numbers", what, N));
  for (std::size_t i = 0; i < N; ++i) all[i] = number(json[i], fmt::format("'{}' [{}]", what, i));
  return all;
}

Pose pose_of(const Json& position, const Json& rotation) {
  const auto p = array_of<3>(position, "position");
  const auto q = array_of<4>(rotation, "rotation");
  Pose pose{{p[0], p[1], p[2]}, Eigen::Quaterniond(q[3], q[0], q[1], q[2])};
  const double norm = pose.rotation.norm();
  if (!(std::abs(norm - 1) <= kUnitTolerance))
    throw std::invalid_argument(
        fmt::format("'rotation' must be a unit quaternion x, y, z, w; its length is {:.6g}", norm));
  pose.rotation.normalize();
  return pose;
}

double struck_m3(const Bucket& bucket) {
  const auto capacity = Capacity::of(bucket);
  return capacity ? capacity->struck_m3() : 0;
}

}  // namespace

void CycleCounter::add(double load_m3) {
  if (emptying_) {
    trough_m3_ = std::min(trough_m3_, load_m3);
    if (load_m3 < trough_m3_ + std::max(least_m3_, *last_m3_ / 4)) return;
    emptying_ = false;
    peak_m3_ = load_m3;
  }
  peak_m3_ = std::max(peak_m3_, load_m3);
  if (!(peak_m3_ > least_m3_) || load_m3 > peak_m3_ / 2) return;
  ++cycles_;
  last_m3_ = peak_m3_;
  trough_m3_ = load_m3;
  emptying_ = true;
}

LiveSite::LiveSite(Session session, std::string name)
    : session_(std::move(session)),
      name_(std::move(name)),
      time_s_(kNaN),
      change_before_m3_(session_.change_m3()),
      mass_before_(session_.books().ground) {
  for (const SessionMachine& machine : session_.machines()) {
    Work& work = work_.emplace_back();
    if (machine.chain) work.joints = machine.chain->movable();
    work.capacity_m3 = struck_m3(machine.bucket);
    const double about_m3 =
        work.capacity_m3 > 0
            ? work.capacity_m3
            : machine.bucket.width_m * machine.bucket.height_m * machine.bucket.height_m;
    work.cycles = CycleCounter(about_m3 / 10);
  }
}

void LiveSite::record(const Recording& recording,
                      const std::function<void(const io::JournalExtent&)>& progress) {
  session_.record(recording, progress);
  recorded_ = true;
  // What the journal knows of loads, cycles are counted by again.
  const double loose_m3 = session_.site().soil->sample_m3() /
                          static_cast<double>(session_.earthmoving().soil
                                                  ? MassUnits(*session_.earthmoving().soil).loose
                                                  : 1);
  io::JournalReader reader(recording.folder / kJournalName);
  while (std::optional<io::JournalRecord> record = reader.next()) {
    const auto* fed = std::get_if<io::JournalState>(&*record);
    if (fed == nullptr) continue;
    ++fed_;
    if (std::isfinite(fed->time_s)) time_s_ = std::fmax(time_s_, fed->time_s);
    using Kind = io::JournalState::Kind;
    if (fed->kind != Kind::kPose && fed->kind != Kind::kJoints) continue;
    durations_.add(static_cast<double>(fed->ns) * 1e-3);
    if (fed->machine < work_.size())
      work_[fed->machine].cycles.add(static_cast<double>(fed->bucket_samples) * loose_m3);
  }
}

/// @param joints hold those of the state
MachineState LiveSite::parse(std::string_view line, std::vector<double>& joints) const {
  const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (json.is_discarded() || !json.is_object())
    throw std::invalid_argument(fmt::format("'{}' is no JSON object", io::printable(line)));
  static const std::vector<std::string> kKeys = {"machine", "time", "joints", "position",
                                                 "rotation"};
  for (const auto& [key, value] : json.items())
    if (std::find(kKeys.begin(), kKeys.end(), key) == kKeys.end())
      throw std::invalid_argument(fmt::format("unknown key '{}'; did you mean '{}'?",
                                              io::printable(key), io::nearest(key, kKeys)));
  if (!json.contains("machine") || !json["machine"].is_string())
    throw std::invalid_argument("'machine' must name a machine");
  MachineState state;
  state.machine = session_.machine(json["machine"].get<std::string>());
  if (json.contains("time") && !json["time"].is_null())
    state.time_s = number(json["time"], "'time'");
  if (std::abs(state.time_s) > kMostTime_s)
    throw std::invalid_argument(
        fmt::format("'time' is {:.6g} s; it must be within {:g} s of 0; are these milliseconds?",
                    state.time_s, kMostTime_s));
  const bool has_pose = json.contains("position") || json.contains("rotation");
  if (has_pose == json.contains("joints"))
    throw std::invalid_argument("give either 'joints' or 'position' and 'rotation'");
  if (has_pose) {
    if (!json.contains("position") || !json.contains("rotation"))
      throw std::invalid_argument("'position' and 'rotation' come together");
    state.pose = pose_of(json["position"], json["rotation"]);
    return state;
  }
  const Json& values = json["joints"];
  if (!values.is_object()) throw std::invalid_argument("'joints' must be an object of numbers");
  const std::vector<std::string>& names = work_[state.machine].joints;
  if (names.empty())
    throw std::invalid_argument(
        fmt::format("machine '{}' has no joints; give it 'position' and "
                    "'rotation'",
                    session_.machines()[state.machine].name));
  for (const auto& [key, value] : values.items())
    if (std::find(names.begin(), names.end(), key) == names.end())
      throw std::invalid_argument(fmt::format("unknown joint '{}'; did you mean '{}'?",
                                              io::printable(key), io::nearest(key, names)));
  for (const std::string& name : names) {
    if (!values.contains(name))
      throw std::invalid_argument(fmt::format("joint '{}' is missing", name));
    joints.push_back(number(values[name], fmt::format("joint '{}'", name)));
  }
  state.joints = joints;
  return state;
}

/// What is dug on a way that nobody went can't be put back.
void LiveSite::require_near(const MachineState& state) const {
  const std::optional<MachineState> last = session_.last(state.machine);
  if (!last) return;
  const Pose pose = state.joints.empty() ? state.pose : session_.pose(state.machine, state.joints);
  const double way_m = (pose.position - last->pose.position).norm();
  if (way_m > kFarthest_m)
    throw std::invalid_argument(fmt::format(
        "machine '{}' would go {:.6g} m straight on in one state; are these metres? States on its "
        "way are at most {} m apart",
        session_.machines()[state.machine].name, way_m, kFarthest_m));
}

StepResult LiveSite::feed(const MachineState& state) {
  StepResult step = session_.update(state);
  if (!step.ok()) return step;
  ++fed_;
  if (std::isfinite(state.time_s)) time_s_ = std::fmax(time_s_, state.time_s);
  durations_.add(step.update.us);
  Work& work = work_[state.machine];
  work.cycles.add(step.update.bucket_m3);
  work.fed = Clock::now();
  const Pose pose = session_.last(state.machine)->pose;
  if (pose.position != work.last.position || pose.rotation.coeffs() != work.last.rotation.coeffs())
    work.moved = work.fed;
  work.last = pose;
  return step;
}

std::string LiveSite::feed(std::string_view line) {
  try {
    std::vector<double> joints;
    const MachineState state = parse(line, joints);
    require_near(state);
    const StepResult step = feed(state);
    if (!step.ok()) return line_of({{"error", step.why}});
    Json answer = {{"cut_m3", step.update.cut_m3}, {"bucket_m3", step.update.bucket_m3}};
    if (session_.earthmoving().soil) {
      answer["bucket_kg"] = session_.bucket_kg(state.machine);
      answer["spilled_m3"] = step.update.spilled_m3;
      answer["slid_m3"] = step.update.slid_m3;
    }
    const io::JournalExtent done = session_.acknowledged();
    answer["acknowledged_s"] = done.updates > 0 ? Json(done.time_s) : Json();
    return line_of(answer);
  } catch (const std::exception& e) {
    return line_of({{"error", e.what()}});
  }
}

Json LiveSite::machine_state(std::size_t i) const {
  const SessionMachine& machine = session_.machines()[i];
  const Work& work = work_[i];
  const Ledger& ledger = session_.ledger(i);
  const bool soil_moves = session_.earthmoving().soil.has_value();
  Json json = {
      {"name", machine.name},
      {"position", nullptr},
      {"rotation", nullptr},
      {"links", Json::array()},
      {"bucket_m3", ledger.bucket_m3()},
      {"bucket_kg", soil_moves ? Json(session_.bucket_kg(i)) : Json()},
      {"fill", work.capacity_m3 > 0 ? Json(ledger.bucket_m3() / work.capacity_m3) : Json()},
      {"cut_m3", ledger.cut_m3()},
      {"cycles", work.cycles.cycles()},
      {"last_load_m3", work.cycles.last_load_m3() ? Json(*work.cycles.last_load_m3()) : Json()},
      {"state", "unseen"}};
  const std::optional<MachineState> last = session_.last(i);
  if (!last) return json;
  json["position"] = numbers(last->pose.position);
  json["rotation"] = numbers(last->pose.rotation.coeffs());
  if (!last->joints.empty())
    for (const Vec3& place : machine.chain->joint_places(last->joints))
      json["links"].push_back(numbers(place));
  json["state"] = Clock::now() - work.moved < kIdleAfter ? "working" : "idle";
  return json;
}

Json LiveSite::state() const {
  Json machines = Json::array();
  for (std::size_t i = 0; i < work_.size(); ++i) machines.push_back(machine_state(i));
  const io::JournalExtent done = session_.acknowledged();
  return {{"type", "state"},
          {"time_s", or_null(time_s_)},
          {"machines", machines},
          {"cut_m3", session_.total().cut_m3()},
          {"acknowledged_s", done.updates > 0 ? Json(done.time_s) : Json()}};
}

Json LiveSite::description() const {
  const Soil& soil = *session_.site().soil;
  Json machines = Json::array();
  for (std::size_t i = 0; i < work_.size(); ++i) {
    const SessionMachine& machine = session_.machines()[i];
    Json one = {{"name", machine.name},
                {"width_m", machine.bucket.width_m},
                {"height_m", machine.bucket.height_m},
                {"capacity_m3", work_[i].capacity_m3 > 0 ? Json(work_[i].capacity_m3) : Json()}};
    for (const Vec2& point : machine.bucket.profile) one["profile"].push_back(numbers(point));
    machines.push_back(std::move(one));
  }
  Json all = {{"type", "site"},
              {"name", name_},
              {"voxel_size_m", soil.voxel_size_m()},
              {"origin", numbers(soil.origin())},
              {"block_side", kBlockSide},
              {"machines", machines},
              {"soil", nullptr}};
  if (const auto& moves = session_.earthmoving().soil)
    all["soil"] = {{"repose_angle", moves->repose_rad},
                   {"swell", moves->swell},
                   {"density", moves->density_kg_m3}};
  return all;
}

std::string LiveSite::machines_csv() const {
  std::string csv = "machine,state,x_m,y_m,z_m,bucket_m3,bucket_kg,cut_m3,cycles,last_load_m3\n";
  for (std::size_t i = 0; i < work_.size(); ++i) {
    const Json json = machine_state(i);
    std::string name = json["name"];
    if (name.find_first_of(",\"\n\r") != std::string::npos) {
      std::string quoted;
      for (const char c : name) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
      name = '"' + quoted + '"';
    }
    const auto cell = [](const Json& value) {
      return value.is_null() ? std::string() : value.dump();
    };
    const Json& at = json["position"];
    csv += fmt::format("{},{},{},{},{},{},{},{},{},{}\n", name, json["state"].get<std::string>(),
                       at.is_null() ? "" : at[0].dump(), at.is_null() ? "" : at[1].dump(),
                       at.is_null() ? "" : at[2].dump(), cell(json["bucket_m3"]),
                       cell(json["bucket_kg"]), cell(json["cut_m3"]), cell(json["cycles"]),
                       cell(json["last_load_m3"]));
  }
  return csv;
}

io::Summary LiveSite::summary() const {
  io::Summary summary;
  summary.scenario = name_;
  summary.updates = durations_;
  const io::JournalExtent done = session_.acknowledged();
  summary.acknowledged_s = done.time_s;
  summary.acknowledged_updates = done.updates;
  summary.total_s = std::chrono::duration<double>(Clock::now() - begin_).count();
  return summary;
}

Books LiveSite::books(const Session& ground) const {
  Books books{*ground.site().soil,
              ground.earthmoving().soil,
              ground.total(),
              ground.books(),
              {},
              change_before_m3_,
              mass_before_};
  for (std::size_t i = 0; i < ground.machines().size(); ++i)
    books.machines.push_back(
        {ground.machines()[i].name, ground.machines()[i].bucket, ground.ledger(i)});
  return books;
}

}  // namespace soilvdb::tools
