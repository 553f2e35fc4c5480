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
#include "io/motion/motion_checks.h"
#include "tools/run/run_folder.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

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

}  // namespace

LiveSite::LiveSite(Session session, std::string name)
    : session_(std::move(session)),
      name_(std::move(name)),
      log_(session_),
      moved_(session_.machines().size()),
      before_{session_.change_m3(), session_.books().ground} {
  for (const SessionMachine& machine : session_.machines())
    joints_.push_back(machine.chain ? machine.chain->movable() : std::vector<std::string>());
}

LiveSite::LiveSite(Session session, std::string name, WorkLog log, const ChangeBefore& before)
    : LiveSite(std::move(session), std::move(name)) {
  log_ = std::move(log);
  before_ = before;
}

void LiveSite::record(const Recording& recording,
                      const std::function<void(const io::JournalExtent&)>& progress) {
  session_.record(recording, progress);
  recorded_ = true;
  // What the journal knows of loads, cycles are counted by again.
  io::JournalReader reader(recording.folder / kJournalName);
  while (std::optional<io::JournalRecord> record = reader.next()) {
    const auto* fed = std::get_if<io::JournalState>(&*record);
    if (fed == nullptr) continue;
    ++fed_;
    log_.add(*fed);
    using Kind = io::JournalState::Kind;
    if (fed->kind == Kind::kPose || fed->kind == Kind::kJoints)
      durations_.add(static_cast<double>(fed->ns) * 1e-3);
  }
}

/// @param joints hold those of the state
MachineState LiveSite::parse(std::string_view line, std::vector<double>& joints) const {
  const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (json.is_discarded() || !json.is_object())
    throw std::invalid_argument(
        fmt::format("'{}' is no JSON object{}", io::printable(line),
                    json.is_discarded() && (line.find("NaN") != std::string_view::npos ||
                                            line.find("Infinity") != std::string_view::npos)
                        ? "; JSON has no NaN and no Infinity: leave such a state out"
                        : ""));
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
  const std::vector<std::string>& names = joints_[state.machine];
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

/// What is dug by joints, or on a way, that no machine has can't be put back: states are held to
/// what rows of a motion are.
void LiveSite::require_likely(const MachineState& state) const {
  const std::optional<MachineState> last = session_.last(state.machine);
  const SessionMachine& machine = session_.machines()[state.machine];
  const auto require = [&](const std::string& fault) {
    if (!fault.empty())
      throw std::invalid_argument(fmt::format("machine '{}': {}", machine.name, fault));
  };
  if (!state.joints.empty()) require(io::state_fault(*machine.chain, state.joints));
  if (!last) return;
  const Pose pose = state.joints.empty() ? state.pose : session_.pose(state.machine, state.joints);
  const double way_m = (pose.position - last->pose.position).norm();
  if (way_m > kFarthest_m)
    throw std::invalid_argument(fmt::format(
        "machine '{}' would go {:.6g} m straight on in one state; are these metres? States on its "
        "way are at most {} m apart",
        machine.name, way_m, kFarthest_m));
  const double after_s = state.time_s - last->time_s;
  if (!(after_s >= 0)) return;  // no time is known, or it goes back, which the session says
  if (!state.joints.empty() && !last->joints.empty())
    require(io::state_fault(*machine.chain, last->joints, state.joints, after_s));
  else
    require(io::state_fault(last->pose, pose, after_s));
}

StepResult LiveSite::feed(const MachineState& state) {
  StepResult step = session_.update(state);
  if (!step.ok()) return step;
  ++fed_;
  durations_.add(step.update.us);
  std::vector<double> at(state.joints.begin(), state.joints.end());
  if (at.empty()) {
    const Vec3& p = state.pose.position;
    const auto& q = state.pose.rotation.coeffs();
    at = {p[0], p[1], p[2], q[0], q[1], q[2], q[3]};
  }
  if (log_.add(state.machine, state.time_s, std::move(at), step.update.bucket_m3))
    moved_[state.machine] = Clock::now();
  return step;
}

std::string LiveSite::feed(std::string_view line) {
  try {
    std::vector<double> joints;
    const MachineState state = parse(line, joints);
    require_likely(state);
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

/// Machines of one that is fed work if they moved just now; else if they did in the end.
Json LiveSite::state() const {
  std::vector<bool> works;
  const bool fed = recorded_ || fed_ > 0;
  for (std::size_t i = 0; i < moved_.size(); ++i)
    works.push_back(fed ? Clock::now() - moved_[i] < std::chrono::duration<double>(kIdleAfter_s)
                        : log_.works(i));
  Json json = site_state(session_, log_, works);
  const io::JournalExtent done = session_.acknowledged();
  json["acknowledged_s"] = done.updates > 0 ? Json(done.time_s) : Json();
  return json;
}

Json LiveSite::description() const {
  const Soil& soil = *session_.site().soil;
  Json machines = Json::array();
  for (std::size_t i = 0; i < moved_.size(); ++i) {
    const SessionMachine& machine = session_.machines()[i];
    const double capacity_m3 = log_.machines()[i].capacity_m3;
    Json one = {{"name", machine.name},
                {"width_m", machine.bucket.width_m},
                {"height_m", machine.bucket.height_m},
                {"capacity_m3", capacity_m3 > 0 ? Json(capacity_m3) : Json()}};
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
              before_.change_m3,
              before_.mass};
  for (std::size_t i = 0; i < ground.machines().size(); ++i)
    books.machines.push_back(
        {ground.machines()[i].name, ground.machines()[i].bucket, ground.ledger(i)});
  return books;
}

}  // namespace soilvdb::tools
