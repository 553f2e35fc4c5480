// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Lines of LandXML: straights, arcs and clothoids of alignments, with the heights of their
// profiles.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

/// Chords leave their arcs by at most this, m.
inline constexpr double kMostSagitta_m = 0.002;

struct Alignments {
  std::vector<std::vector<Vec3>> lines;  ///< as of DesignLines, but in the file's CRS
  std::string epsg = {}, wkt = {};       ///< as of TinInput
  double unit_m = 1;
  std::string unit = {};
  std::vector<std::string> doubts = {};  ///< without the file's name
};

/// All lines of the geometry (CoordGeom) of alignments, plan features and parcels.
/// @throw InputError with the line of what is not supported, or contradicts itself
Alignments read_alignments(const std::filesystem::path& file);

}  // namespace soilvdb::inline v0::io
