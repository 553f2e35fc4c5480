// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The description of a session's site, to compare it with a state's or a recording's.
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "io/file/json.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/tool_shape.h"
#include "tools/run/session_state.h"

namespace soilvdb::inline v0 {
namespace {

using Json = nlohmann::json;

/// A chain by its poses: with each joint moved alone, the pose shows its axis.
Json places(const Chain& chain) {
  const std::vector<std::string> names = chain.movable();
  Json all = {{"joints", names}};
  for (std::size_t moved = 0; moved <= names.size(); ++moved) {
    std::vector<double> joints(names.size(), 0.0);
    if (moved > 0) joints[moved - 1] = 1;
    const Pose pose = chain.world_from_bucket(joints);
    all["at"].push_back({io::numbers(pose.position), io::numbers(pose.rotation.coeffs())});
  }
  return all;
}

}  // namespace

nlohmann::json Session::State::description(bool with_ground) const {
  const Ground& ground = *site.ground;
  const io::BaseReference& base = site.reference;
  Json all = {{"voxel_size_m", ground.voxel_size_m()}, {"origin_m", io::numbers(ground.origin())}};
  if (const auto* plane = std::get_if<io::PlaneTerrain>(&base.terrain))
    all["plane"] = {plane->height_m, io::numbers(plane->slope)};
  else
    all["terrain"] = base.checksum;
  if (with_ground && !ground.chunks().empty())
    all["ground"] = fmt::format("{:016x}", ground.state_hash());
  for (const SiteMachine& machine : model().machines) {
    const Bucket& bucket = machine.bucket;
    Json one = {{"name", machine.name},
                {"bucket", {bucket.width_m, bucket.height_m}},
                {"profile", Json::array()}};
    for (const Vec2& point : bucket.profile) one["profile"].push_back(io::numbers(point));
    if (bucket.shape) one["tool"] = fmt::format("{:016x}", io::crc64(bucket.shape->save()));
    if (bucket.dump_angle_rad) one["dump_angle_rad"] = *bucket.dump_angle_rad;
    if (machine.chain) one["chain"] = places(*machine.chain);
    all["machines"].push_back(std::move(one));
  }
  const Earthmoving& earthmoving = model().earthmoving;
  if (const auto& soil_moves = earthmoving.soil) {
    all["soil"] = {soil_moves->repose_rad, soil_moves->swell, soil_moves->density_kg_m3,
                   soil_moves->cohesion_pa.value_or(-1), soil_moves->friction_rad.value_or(-1)};
    for (const Pour& pour : earthmoving.pours)
      all["pours"].push_back({io::numbers(pour.at_m), pour.begin_s, pour.end_s, pour.volume_m3});
    for (const Hopper& hopper : earthmoving.hoppers)
      all["hoppers"].push_back({io::numbers(hopper.box_m.min()), io::numbers(hopper.box_m.max()),
                                hopper.top_m, fmt::format("{} {}", hopper.begin_s, hopper.end_s)});
  }
  return all;
}

std::string difference(const Json& before, const Json& now) {
  const Json changes = Json::diff(before, now);
  if (changes.empty()) return "";
  const Json::json_pointer path(changes[0]["path"].get<std::string>());
  std::vector<std::string> words;
  for (Json::json_pointer at = path; !at.empty(); at = at.parent_pointer())
    words.insert(words.begin(), at.back());
  if (words.empty()) return "all of it";
  std::string said = words[0];
  const bool counted = said == "machines" || said == "pours" || said == "hoppers";
  if (!counted || words.size() == 1 || words[1] == "-") return said;  // "-": appended element
  said = fmt::format("{} {}", said.substr(0, said.size() - 1), std::stoul(words[1]) + 1);
  const bool named = words.size() > 2 && words[0] == "machines";  // other arrays hold numbers
  return named ? fmt::format("{}: {}", said, words[2]) : said;
}

}  // namespace soilvdb::inline v0
