// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Parses and checks the lines of a live site's feed.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "io/file/json.h"
#include "io/file/text.h"
#include "tools/serve/geodetic_line.h"
#include "tools/serve/line_values.h"
#include "tools/serve/live_forces.h"
#include "tools/serve/live_site.h"
#include "tools/serve/target.h"

namespace soilvdb::tools {
namespace {

using Line = nlohmann::json;

/// Farthest ahead of all earlier times in one step.
constexpr double kFarthestAhead_s = 3600;

const Line& machine_in(const Line& json) {
  if (!json.contains("machine") || !json["machine"].is_string())
    throw std::invalid_argument("'machine' must name a machine");
  return json["machine"];
}

Pose base_in(const Line& json) {
  if (!json.is_object() || !json.contains("position") || !json.contains("rotation"))
    throw std::invalid_argument(
        "'base' must be an object with 'position' and 'rotation' of the urdf's root");
  try {
    require_keys(json, {"position", "rotation"});
    return line_pose(json["position"], json["rotation"]);
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(fmt::format("'base': {}", e.what()));
  }
}

double host_time_s() {
  using Seconds = std::chrono::duration<double>;
  return Seconds(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace

/// @param joints storage for the state's joints
MachineState LiveSite::parse(const Line& json, std::vector<double>& joints) {
  require_keys(json, {"machine", "time", "joints", "base", "geodetic", "position", "rotation",
                      "force", "sequence", "fix"});
  MachineState state;
  state.machine = session_.machine(machine_in(json).get<std::string>());
  if (session_.is_retired(state.machine))
    throw std::invalid_argument(
        fmt::format("machine '{}' is retired; POST /machines with a 'restore' brings it back",
                    session_.machines()[state.machine].name));
  if (json.contains("time") && !json["time"].is_null()) state.time_s = line_time(json["time"]);
  const bool has_pose = json.contains("position") || json.contains("rotation");
  if (json.contains("geodetic")) {
    if (has_pose || json.contains("base"))
      throw std::invalid_argument(
          "'geodetic' is in place of 'base', or of 'position' and 'rotation'; give one of them");
    state.pose = parse_geodetic(json, state.machine);
    if (!session_.machines()[state.machine].chain) return state;
    state.base = state.pose;
  }
  if (has_pose == json.contains("joints"))
    throw std::invalid_argument("give either 'joints' or 'position' and 'rotation'");
  if (json.contains("base")) {
    if (has_pose)
      throw std::invalid_argument(
          "'base' goes with 'joints'; 'position' and 'rotation' are those of the bucket");
    state.base = base_in(json["base"]);
  } else if (!has_pose && !state.base) {
    state.base = feeds_[state.machine].driven_to;
  }
  if (has_pose) {
    if (!json.contains("position") || !json.contains("rotation"))
      throw std::invalid_argument("'position' and 'rotation' come together");
    state.pose = line_pose(json["position"], json["rotation"]);
    return state;
  }
  const Line& values = json["joints"];
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
    joints.push_back(number_of(values[name], fmt::format("joint '{}'", name)));
  }
  state.joints = joints;
  return state;
}

Pose LiveSite::parse_geodetic(const Line& json, std::size_t machine) {
  const SiteMachine& of = session_.machines()[machine];
  if (!of.gnss)
    throw std::invalid_argument(fmt::format(
        "machine '{}' has no 'gnss' in the scenario, the places of its antennas; give it that, or "
        "leave 'geodetic' out",
        of.name));
  if (of.chain && !json.contains("joints"))
    throw std::invalid_argument("'geodetic' is where the root of the urdf is; give 'joints', too");
  if (!of.chain && json.contains("joints"))
    throw std::invalid_argument(
        fmt::format("machine '{}' has no joints; 'geodetic' is where its bucket is", of.name));
  auto found = geodetic_.find(machine);
  if (found == geodetic_.end()) {
    const io::Site& site = session_.site();
    found = geodetic_.emplace(machine, io::Geodetic(*of.gnss, site.crs_wkt, site.bounds)).first;
  }
  return geodetic_pose(json["geodetic"], *of.gnss, found->second, line_fix(json) == Fix::kFixed);
}

bool LiveSite::asks_for_force(const Line& json, std::size_t machine) const {
  if (!json.contains("force")) return false;
  if (!json["force"].is_boolean()) throw std::invalid_argument("'force' must be true or false");
  if (!json["force"].get<bool>()) return false;
  if (!session_.earthmoving().soil) throw std::invalid_argument(kForceNeedsSoil);
  if (const SiteMachine& of = session_.machines()[machine]; of.bucket.shape)
    throw std::invalid_argument(
        fmt::format("machine '{}' has a closed tool; 'force' is known for buckets", of.name));
  return true;
}

void LiveSite::reset_clock(const Line& json) {
  require_keys(json, {"machine", "clock"});
  if (json["clock"] != "reset") throw std::invalid_argument("'clock' must be \"reset\"");
  const std::size_t machine = session_.machine(machine_in(json).get<std::string>());
  const std::uint64_t before = session_.changes();
  const StepResult step = session_.reset_clock(machine);
  require_made(step, before);
  ++fed_.count;
  ++changes_of_past_;
  fed_.log.set_clock(machine);
  fed_.places.set_clock(machine);
}

std::string LiveSite::how_to_set_clock(std::size_t machine) const {
  return fmt::format("confirm it: {} '{}clock?machine={}'", curl_, address_,
                     in_address(session_.machines()[machine].name));
}

std::optional<double> LiveSite::clock_ahead_s(const MachineState& state) {
  if (!state.time_s || *state.time_s < kLeastEpoch_s) return {};
  return *state.time_s - host_time_s();
}

/// A state far ahead needs confirmation by another, because later states would be refused after it.
void LiveSite::require_soon(const MachineState& state) {
  if (!state.time_s || fed_.log.machines()[state.machine].clock_is_set) return;
  const std::optional<double> latest_s = fed_.log.time_s();
  const std::optional<double> doubted_s = std::exchange(doubted_s_[state.machine], {});
  const double time_s = *state.time_s;
  if (latest_s && time_s - *latest_s <= kFarthestAhead_s) return;
  const double ahead_s = time_s - host_time_s();
  if (time_s > kLeastEpoch_s && ahead_s > kFarthestAhead_s)
    throw std::invalid_argument(fmt::format(
        "machine '{}': 'time' is {} s, {:.1f} hours ahead of this computer's clock; set the clock "
        "that is wrong. If the machine's is right, {}",
        session_.machines()[state.machine].name, time_s, ahead_s / 3600,
        how_to_set_clock(state.machine)));
  if (!latest_s) return;
  if (doubted_s && time_s >= *doubted_s && time_s - *doubted_s <= kFarthestAhead_s) return;
  doubted_s_[state.machine] = time_s;
  throw std::invalid_argument(fmt::format(
      "machine '{}': 'time' is {} s, more than an hour ahead of the site's latest, {} s; "
      "if that is right send it again: its next state up to an hour later is taken",
      session_.machines()[state.machine].name, time_s, *latest_s));
}

}  // namespace soilvdb::tools
