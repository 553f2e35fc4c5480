// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Coordinate reference systems: which ones a site can be in, and how to get there from the others.
#pragma once

#include <filesystem>
#include <string>

#include "soilvdb/types.h"

class OGRSpatialReference;

namespace soilvdb::inline v0::io {

/// "EPSG:26918", else the CRS's name; empty for an empty WKT or one that can't be read.
std::string crs_label(const std::string& wkt);

/// The UTM zone (by EPSG, WGS 84) at a place in degrees; the polar systems beyond 84 N and 80 S.
int utm_epsg(double longitude, double latitude);

/// @param centre middle of the raster, in `srs`, x east and y north
/// @param vertical_unit name of the unit of the heights; may be empty
/// @throw InputError unless x, y and heights are in metres, and those of x and y are metres on the
///        ground, too (areas within 1.25 %); with the command that mends it.
void require_metres(const std::filesystem::path& file, const OGRSpatialReference& srs,
                    const Vec2& centre, const std::string& vertical_unit);

/// The same for a raster without a CRS: only its heights have a unit.
void require_metres(const std::filesystem::path& file, const std::string& vertical_unit);

/// The command that makes of `file` the raster NAME_SUFFIX.tif beside it, with no height outside of
/// it. @param options of gdalwarp, may be empty
std::string warp_command(const std::filesystem::path& file, const std::string& options,
                         const std::string& suffix);

/// The one that takes `file` to a projected CRS in metres. @param source -s_srs, may be empty
std::string reproject_command(const std::filesystem::path& file, int epsg,
                              const std::string& source);

}  // namespace soilvdb::inline v0::io
