// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scenario/receivers.h"

#include <fmt/format.h>

#include <algorithm>

#include "io/file/text.h"
#include "io/terrain/geodetic.h"

namespace soilvdb::inline v0::io {
namespace {

/// Farthest from the frame that they are mounted in.
constexpr double kMostLever_m = 100;
/// Least part of the antennas' distance that is beside each other, not above.
constexpr double kLeastLevelShare = 0.2;

}  // namespace

Gnss read_gnss(const YamlMap& machine) {
  const YamlMap map = machine.map("gnss", {"antennas", "crs", "site_crs", "geoid"});
  Gnss gnss{map.places("antennas")};
  if (gnss.antennas_m.empty() || gnss.antennas_m.size() > 2)
    map.fail("antennas", fmt::format("antennas has {} places; it must have one or two, of the "
                                     "antennas on the machine",
                                     gnss.antennas_m.size()));
  for (const Vec3& place : gnss.antennas_m)
    if (place.norm() > kMostLever_m)
      map.fail("antennas", fmt::format("antennas has a place {:.4g} m from the machine's frame; it "
                                       "must be within {} m",
                                       place.norm(), kMostLever_m));
  if (gnss.antennas_m.size() == 2) {
    const Vec3 line = gnss.antennas_m[1] - gnss.antennas_m[0];
    const double apart_m = line.head<2>().norm();
    const double least_m = std::max(kLeastBaseline_m, kLeastLevelShare * line.norm());
    if (apart_m < least_m)
      map.fail("antennas", fmt::format("antennas are {:.4g} m apart beside each other; for a "
                                       "heading it must be {:.4g} m or more",
                                       apart_m, least_m));
  }
  if (map.has("crs")) gnss.crs = map.text("crs");
  if (map.has("site_crs")) gnss.site_crs = map.text("site_crs");
  if (!map.has("geoid")) return gnss;
  if (parse_number(map.text("geoid"))) {
    gnss.undulation_m = map.number("geoid", -kMostUndulation_m, kMostUndulation_m, "m");
  } else {
    const std::filesystem::path file = map.path("geoid");
    std::error_code none;
    gnss.geoid = std::filesystem::is_regular_file(file, none)
                     ? std::filesystem::absolute(file).string()
                     : map.text("geoid");  // one of PROJ's
  }
  return gnss;
}

}  // namespace soilvdb::inline v0::io
