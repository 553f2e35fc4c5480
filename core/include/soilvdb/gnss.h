// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Antennas of a satellite receiver (GNSS) on a machine, and the pose that their places give.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// How positions of a machine's receiver become poses of a site.
struct Gnss {
  /// Lever arms of one or two antennas, m, in the frame of the chain's root, or of the bucket of a
  /// machine without a chain.
  std::vector<Vec3> antennas_m;
  std::string crs = "EPSG:4979";  ///< of latitudes, longitudes and heights above its ellipsoid
  std::string site_crs = {};      ///< empty: the terrain's
  /// Where the site's heights begin, above the ellipsoid: a grid of a geoid, or the same height
  /// everywhere, m. Without both, the site's vertical CRS tells it.
  std::string geoid = {};
  std::optional<double> undulation_m = {};
};

/// Horizontal distance of two antennas on an upright machine, at least, m.
inline constexpr double kLeastBaseline_m = 0.5;

/// The pose of the frame in which two antennas are mounted. The line through them is kept as it was
/// measured, and the frame turned about it so that `up` points up as far as it can. Only the line's
/// direction counts, so its heading is from grid north, and the map's scale does not matter. The
/// middle between the antennas is where it was measured.
/// @param mounted_m in that frame @param places_m world @param up unit, in that frame
/// @throw std::invalid_argument if the line is upright, and the heading therefore not known
Pose pose_of_antennas(std::span<const Vec3> mounted_m, std::span<const Vec3> places_m,
                      const Vec3& up);

}  // namespace soilvdb::inline v0
