// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Lines of a design, to draw: LandXML; DXF, GeoPackage, GeoJSON and Shapefile by GDAL.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

struct DesignLines {
  std::vector<std::vector<Vec3>> lines;  ///< two points or more each, m; z NaN: without a height
  std::vector<std::string> warnings;     ///< a line each
};

inline constexpr std::size_t kMostLinePoints = 200'000;

/// All lines and outlines of areas, in the site's CRS.
/// @param site_wkt CRS of the terrain; empty: unknown
/// @throw InputError for a file that isn't one of these, has no lines or more than kMostLinePoints
///        points, or whose coordinates can't be brought into the site
DesignLines read_lines(const std::filesystem::path& file, const std::string& site_wkt);

}  // namespace soilvdb::inline v0::io
