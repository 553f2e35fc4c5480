// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Coordinate reference systems: which ones a site can be in, and how to get there from the others.
#pragma once

#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

class RasterAdvice;
/// A CRS of GDAL's: an OGRSpatialReferenceH.
using Srs = void*;

/// "EPSG:26918", else the CRS's name; empty for an empty WKT or one that can't be read.
std::string crs_label(const std::string& wkt);

/// The UTM zone (by EPSG, WGS 84) at a place in degrees; the polar systems beyond 84 N and 80 S.
int utm_epsg(double longitude, double latitude);

/// @param srs null: there is none. @param centre in its coordinates
/// @param vertical_unit name of the heights' unit; may be empty
/// @return a warning where the unit is not known and taken as metres
/// @throw InputError unless heights are in metres, with the command that converts them
std::vector<std::string> require_metre_heights(const RasterAdvice& advice, Srs srs,
                                               const Vec2& centre,
                                               const std::string& vertical_unit);

/// Does a raster say what its heights are in?
bool names_height_unit(Srs srs, const std::string& vertical_unit);

/// @param centre middle of the raster, in `srs`, x east and y north
/// @throw InputError unless x and y are in metres that are metres on the ground, too (areas within
///        1.25 %); with the command that mends it.
void require_metres(const RasterAdvice& advice, Srs srs, const Vec2& centre,
                    const std::string& vertical_unit);

/// A CRS as text, WKT 2; empty if it can't be told so.
std::string wkt_of(Srs srs);

/// In what two CRSs of surfaces that are to be compared differ, or can't be seen to be the same: a
/// line for x and y, and one for heights.
/// @param a_wkt, b_wkt empty: not known
std::vector<std::string> crs_differences(const std::string& a_name, const std::string& a_wkt,
                                         const std::string& b_name, const std::string& b_wkt);

}  // namespace soilvdb::inline v0::io
