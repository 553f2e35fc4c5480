// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/geodetic_line.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <vector>

#include "tools/serve/line_values.h"

namespace soilvdb::tools {
namespace {

/// Largest difference of the antennas' distance from that on the machine: some standard deviations
/// of two fixed positions, and of how well the lever arms are known.
constexpr double kBaselineTolerance_m = 0.1;

/// Tilt that no machine works at, and largest difference of sines between the line through the
/// antennas and an inclinometer: some degrees.
constexpr double kMostTilt_rad = 0.8, kTiltTolerance = 0.1;

Vec3 antenna_place(const nlohmann::json& json, const io::Geodetic& geodetic) {
  if (!json.is_object())
    throw std::invalid_argument("an antenna must be an object with 'lat', 'lon' and 'height'");
  require_keys(json, {"lat", "lon", "height"});
  const auto number = [&](const char* key) {
    return number_of(json.value(key, nlohmann::json()), fmt::format("'{}'", key));
  };
  return geodetic.in_site({number("lat"), number("lon"), number("height")});
}

/// What points up in the frame, by an inclinometer's roll and pitch as in URDF; without them, that
/// frame's z.
Vec3 up_of(const nlohmann::json& json) {
  const auto angle = [&](const char* key) {
    const double rad = json.contains(key) ? number_of(json[key], fmt::format("'{}'", key)) : 0;
    if (!(std::abs(rad) <= kMostTilt_rad))
      throw std::invalid_argument(
          fmt::format("'{}' is {}; it must be in radians, within {}", key, rad, kMostTilt_rad));
    return rad;
  };
  return from_rpy(angle("roll"), angle("pitch"), 0).conjugate() * Vec3::UnitZ();
}

void require_baseline(const std::vector<Vec3>& mounted_m, const std::vector<Vec3>& places_m) {
  const double apart_m = (places_m[1] - places_m[0]).norm();
  const double mounted_apart_m = (mounted_m[1] - mounted_m[0]).norm();
  if (!(std::abs(apart_m - mounted_apart_m) <= kBaselineTolerance_m))
    throw std::invalid_argument(
        fmt::format("the antennas are {:.3f} m apart, and {:.3f} m in the scenario; these must "
                    "agree to {} m, or the position is no 'fix' of 'rtk_fixed'",
                    apart_m, mounted_apart_m, kBaselineTolerance_m));
}

Pose pose_in(const nlohmann::json& json, const Gnss& gnss, const io::Geodetic& geodetic,
             bool is_fixed) {
  const std::size_t count = gnss.antennas_m.size();
  if (!json.is_object() || !json.contains("antennas") || !json["antennas"].is_array())
    throw std::invalid_argument("it must be an object with an array 'antennas'");
  require_keys(json, {"antennas", "rotation", "roll", "pitch"});
  if (json["antennas"].size() != count)
    throw std::invalid_argument(fmt::format("'antennas' has {} places; the scenario has {}",
                                            json["antennas"].size(), count));
  const bool has_tilt = json.contains("roll") || json.contains("pitch");
  if (count == 1 ? has_tilt || !json.contains("rotation") : json.contains("rotation"))
    throw std::invalid_argument(
        count == 1 ? "one antenna goes with a 'rotation', x, y, z, w in the world"
                   : "two antennas tell the rotation; 'roll' and 'pitch' may go with them");
  std::vector<Vec3> places_m;
  for (const auto& antenna : json["antennas"]) places_m.push_back(antenna_place(antenna, geodetic));
  if (count == 1) {
    Pose pose = line_pose(nlohmann::json{0, 0, 0}, json["rotation"]);
    pose.position = places_m[0] - pose.rotation * gnss.antennas_m[0];
    return pose;
  }
  const Vec3 up = up_of(json);
  const Pose pose = pose_of_antennas(gnss.antennas_m, places_m, up);
  if (is_fixed) require_baseline(gnss.antennas_m, places_m);
  if (is_fixed && has_tilt) {
    const double mounted = (gnss.antennas_m[1] - gnss.antennas_m[0]).normalized().dot(up);
    const double measured = (places_m[1] - places_m[0]).normalized().z();
    if (!(std::abs(mounted - measured) <= kTiltTolerance))
      throw std::invalid_argument(fmt::format(
          "the line through the antennas rises by {:.3f}, and by {:.3f} with 'roll' and 'pitch'; "
          "these must agree to {}: radians, the antennas' order?",
          measured, mounted, kTiltTolerance));
  }
  return pose;
}

}  // namespace

Pose geodetic_pose(const nlohmann::json& json, const Gnss& gnss, const io::Geodetic& geodetic,
                   bool is_fixed) {
  try {
    return pose_in(json, gnss, geodetic, is_fixed);
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(fmt::format("'geodetic': {}", e.what()));
  }
}

}  // namespace soilvdb::tools
