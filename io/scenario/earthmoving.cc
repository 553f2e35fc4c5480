// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scenario/earthmoving.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <numbers>

#include "core/constants.h"
#include "core/tool/polygon.h"
#include "io/file/text.h"
#include "io/scenario/newcomer.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kRightAngle = std::numbers::pi / 2;
constexpr double kRadPerDegree = std::numbers::pi / 180;
constexpr double kSteepRepose = 60 * kRadPerDegree;  // steeper than any loose soil
constexpr double kNoAreaM2 = 1e-9;
constexpr std::size_t kMostHoppers = 10'000;  // all pairs are compared

/// An angle of at least `least`, or more than it, and below a right angle.
double read_angle(const YamlMap& soil, const std::string& key, bool zero_is_good) {
  const double angle = soil.number(key);
  if ((angle > 0 || (zero_is_good && angle == 0)) && angle < kRightAngle) return angle;
  const bool degrees = angle > kRightAngle && angle < 90;
  soil.fail(key, fmt::format("{} is {}; it must be in radians, {} 0 and less than 1.5708{}", key,
                             angle, zero_is_good ? "at least" : "more than",
                             degrees ? fmt::format(": {:g} degrees are {:.3g}", angle,
                                                   angle * kRadPerDegree)
                                     : ""));
}

void check_needs_soil(const YamlMap& scenario, const std::string& key, const Scenario& result) {
  if (result.soil) return;
  scenario.fail(key, fmt::format("'{}' are for a scenario with 'soil', which says how it moves; "
                                 "add that, or remove '{}'",
                                 key, key));
}

bool overlap(const Hopper& a, const Hopper& b) {
  return (a.box_m.min().array() < b.box_m.max().array()).all() &&
         (b.box_m.min().array() < a.box_m.max().array()).all() && a.begin_s < b.end_s &&
         b.begin_s < a.end_s;
}

/// A hopper without its time.
Hopper read_box(const YamlMap& map, const std::string& name) {
  Hopper hopper;
  hopper.name = name;
  const auto box = map.numbers("box", 4);
  for (std::size_t i = 0; i < 2; ++i) {
    if (box[i] < box[i + 2]) continue;
    const char axis = "xy"[i];
    map.fail("box", fmt::format("box goes from {0} {1} to {0} {2}; it must be [xmin, ymin, xmax, "
                                "ymax], {0}min less than {0}max",
                                axis, box[i], box[i + 2]));
  }
  hopper.box_m = {Vec2(box[0], box[1]), Vec2(box[2], box[3])};
  hopper.top_m = map.number("top");
  return hopper;
}

Hopper hopper_of(const YamlMap& map, Names& names) {
  Hopper hopper = read_box(map, names.take(map, "hopper"));
  if (!map.has("time")) return hopper;
  const auto time = map.numbers("time", 2);
  if (time[0] >= time[1]) {
    map.fail("time", fmt::format("time is from {} to {} s; a hopper must be gone later than it "
                                 "comes",
                                 time[0], time[1]));
  }
  hopper.begin_s = time[0];
  hopper.end_s = time[1];
  return hopper;
}

void require_apart(const YamlMap& map, const Hopper& hopper, const Scenario& result) {
  const auto in_the_way = std::find_if(result.hoppers.begin(), result.hoppers.end(),
                                       [&](const Hopper& other) { return overlap(hopper, other); });
  if (in_the_way == result.hoppers.end()) return;
  map.fail("box", fmt::format("hopper '{}' overlaps hopper '{}'; they must be apart in plan, "
                              "or one gone when the other comes",
                              hopper.name, in_the_way->name));
}

}  // namespace

std::string Names::take(const YamlMap& map, const std::string& kind) {
  const std::string name = map.name("name");
  const auto [at, is_new] = kinds_.try_emplace(name, kind);
  if (at->second == kind && !is_new)
    map.fail("name", fmt::format("{} '{}' is there twice; names must differ", kind, name));
  if (at->second == "machine" && kind != "machine")
    map.fail("name",
             fmt::format("{} '{}' has the name of a machine; names must differ", kind, name));
  at->second = kind;
  return name;
}

void read_soil(const YamlMap& scenario, Scenario& result) {
  if (!scenario.has("soil")) return;
  const YamlMap map = scenario.map("soil", {"repose_angle", "swell", "density", "cohesion",
                                            "friction_angle", "tool_friction", "adhesion"});
  SoilProperties soil;
  soil.repose_rad = read_angle(map, "repose_angle", /*zero_is_good=*/false);
  if (map.has("swell")) soil.swell = map.number("swell");
  if (soil.swell < 0 || soil.swell > kMaxSwell) {
    map.fail("swell", fmt::format("swell is {}; it must be loose over bank volume less 1, a share "
                                  "from 0 to {:g}{}",
                                  soil.swell, kMaxSwell,
                                  soil.swell > 0 ? fmt::format(": {:g} percent are {:g}",
                                                               soil.swell, soil.swell / 100)
                                                 : ""));
  }
  if (map.has("density")) soil.density_kg_m3 = map.number("density");
  if (soil.density_kg_m3 <= 0) {
    map.fail("density",
             fmt::format("density is {} kg/m3; it must be more than 0", soil.density_kg_m3));
  }
  if (map.has("cohesion")) {
    soil.cohesion_pa = map.number("cohesion");
    if (*soil.cohesion_pa < 0)
      map.fail("cohesion",
               fmt::format("cohesion is {} Pa; it must be 0 or more", *soil.cohesion_pa));
    if (!map.has("density")) {
      map.fail("cohesion", "'cohesion' needs 'density'; add it, in kg/m3 of bank soil");
    }
  }
  if (map.has("friction_angle"))
    soil.friction_rad = read_angle(map, "friction_angle", /*zero_is_good=*/true);
  if (map.has("tool_friction"))
    soil.tool_friction_rad = read_angle(map, "tool_friction", /*zero_is_good=*/true);
  if (map.has("adhesion")) soil.adhesion_pa = map.number("adhesion");
  if (soil.adhesion_pa < 0)
    map.fail("adhesion", fmt::format("adhesion is {} Pa; it must be 0 or more", soil.adhesion_pa));
  if (soil.repose_rad > kSteepRepose) {
    result.warnings.push_back(
        fmt::format("{}: a repose_angle of {:g} rad, {:.1f} degrees, is steeper than loose soil "
                    "stands; most is from 0.44 to 0.79",
                    map.place("repose_angle"), soil.repose_rad, soil.repose_rad / kRadPerDegree));
  }
  result.soil = soil;
}

void read_pours(const YamlMap& scenario, Scenario& result, Names& names) {
  if (!scenario.has("pours")) return;
  check_needs_soil(scenario, "pours", result);
  for (const YamlMap& map : scenario.maps("pours", "pour", {"name", "at", "time", "volume"})) {
    Pour pour;
    pour.name = names.take(map, "pour");
    pour.at_m = Vec3(map.numbers("at", 3).data());
    const auto time = map.numbers("time", 2);
    if (time[0] > time[1]) {
      map.fail("time", fmt::format("time is from {} to {} s; a pour must not end before it begins",
                                   time[0], time[1]));
    }
    pour.begin_s = time[0];
    pour.end_s = time[1];
    pour.volume_m3 = map.number("volume");
    if (pour.volume_m3 <= 0)
      map.fail("volume", fmt::format("volume is {} m3; it must be more than 0", pour.volume_m3));
    result.pours.push_back(std::move(pour));
  }
}

void read_hoppers(const YamlMap& scenario, Scenario& result, Names& names) {
  if (!scenario.has("hoppers")) return;
  check_needs_soil(scenario, "hoppers", result);
  const auto maps = scenario.maps("hoppers", "hopper", {"name", "box", "top", "time"});
  if (maps.size() > kMostHoppers) {
    scenario.fail("hoppers",
                  fmt::format("hoppers has {}; it may have at most {}", maps.size(), kMostHoppers));
  }
  for (const YamlMap& map : maps) {
    Hopper hopper = hopper_of(map, names);
    require_apart(map, hopper, result);
    result.hoppers.push_back(std::move(hopper));
  }
}

Hopper read_hopper(const std::string& text, double begin_s, double end_s, const Scenario& site) {
  if (!site.soil) throw InputError("hoppers are for a site with 'soil', and this one has none");
  if (site.hoppers.size() >= kMostHoppers)
    throw InputError(fmt::format("a site has at most {} hoppers", kMostHoppers));
  Hopper hopper;
  read_newcomer(text, site, "hopper", {"name", "box", "top"}, [&](const YamlMap& map) {
    const std::string name = map.name("name");
    require_new_name(name, site);
    hopper = read_box(map, name);
    hopper.begin_s = begin_s;
    hopper.end_s = end_s;
    require_apart(map, hopper, site);
  });
  return hopper;
}

void check_capacity(const YamlMap& map, const Bucket& bucket) {
  if (bucket.profile.empty() || area_of(bucket.profile) > kNoAreaM2) return;
  map.fail("profile",
           "profile gives the bucket a capacity of zero; it must enclose an area with "
           "the mouth");
}

void warn_if_never_dumps(const YamlMap& machine, const std::string& name, const Bucket& bucket,
                         Scenario& result) {
  if (!result.soil || !bucket.profile.empty() || bucket.dump_angle_rad) return;
  result.warnings.push_back(
      fmt::format("{}: the bucket of '{}' has neither profile nor dump_angle: it holds any amount "
                  "of soil and never dumps it",
                  machine.place("bucket"), printable(name)));
}

}  // namespace soilvdb::inline v0::io
