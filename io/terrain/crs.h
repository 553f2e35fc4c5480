// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Coordinate reference systems: which ones a site can have, and conversions from others.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

class RasterAdvice;
/// A CRS of GDAL's: an OGRSpatialReferenceH.
using Srs = void*;

/// "EPSG:26918", or else the CRS's name; empty for an empty or invalid WKT.
std::string crs_label(const std::string& wkt);
/// The same of its map, whatever its heights are above.
std::string map_label(const std::string& wkt);

/// The UTM zone (EPSG code, WGS 84) of a place in degrees; UPS beyond 84 N and 80 S.
int utm_epsg(double longitude, double latitude);

/// @param srs null: unknown @param centre in its coordinates
/// @param vertical_unit name of the heights' unit; may be empty
/// @return a warning if the unit is unknown and taken as metres
/// @throw InputError unless heights are in metres, with the command that converts them
std::vector<std::string> require_metre_heights(const RasterAdvice& advice, Srs srs,
                                               const Vec2& centre,
                                               const std::string& vertical_unit);

/// Does a raster give the unit of its heights?
bool names_height_unit(Srs srs, const std::string& vertical_unit);

/// @param centre middle of the raster, in `srs`, x east and y north
/// @throw InputError, with the command that fixes it, unless x and y are in metres that are also
///        metres on the ground (areas within 1.25 %).
void require_metres(const RasterAdvice& advice, Srs srs, const Vec2& centre,
                    const std::string& vertical_unit);

/// WKT 2 of a CRS whose coordinates a design file gives in a unit of length: in metres, as the
/// file's coordinates become. Empty if the CRS isn't known.
/// @param epsg a code, also with "EPSG:" before it; may be empty @param wkt may be empty
/// @param centre_m middle of the surface
/// @throw InputError for a CRS in degrees, in another unit, or not true to scale
std::string metre_crs(const std::filesystem::path& file, const std::string& epsg,
                      const std::string& wkt, double unit_m, const std::string& unit,
                      const Vec2& centre_m);

/// A CRS as WKT 2; empty if it has none.
std::string wkt_of(Srs srs);

/// Differences between two CRSs of surfaces to compare, or doubts that they are equal: one line for
/// x and y, one for heights.
/// @param a_wkt, b_wkt empty: unknown
std::vector<std::string> crs_differences(const std::string& a_name, const std::string& a_wkt,
                                         const std::string& b_name, const std::string& b_wkt);
/// Which of them are certain: both surfaces name a CRS. Empty: not that.
struct CrsConflicts {
  std::string place = {}, heights = {};
};
CrsConflicts crs_conflicts(const std::string& a_name, const std::string& a_wkt,
                           const std::string& b_name, const std::string& b_wkt);

}  // namespace soilvdb::inline v0::io
