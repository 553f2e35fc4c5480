// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numbers and names as people read them in the program's output.
#pragma once

#include <string>

#include "soilvdb/io/site.h"

namespace soilvdb::tools {

/// Prints a line to standard error, "soilvdb: " first. Without control characters: it may quote
/// names and fields, which hold anything. That it can't be printed is no reason to stop.
void say(std::string line);

/// Four significant digits without an exponent for anything a site can hold: "0.03927", "1234.5".
std::string number(double value);

/// A length as it was given, without what computing left of it: "0.208" for 0.20800000000000002.
std::string length_text(double length_m);

/// "12.3 MB", by powers of 1000.
std::string bytes(double count);

/// A time for file names and messages: microseconds at most, no trailing zeros: "12.5".
std::string time_text(double seconds);

/// "1 update", "2 updates".
std::string counted(double count, const std::string& noun);

/// "EPSG:26918", or what it means that there is none.
std::string crs_text(const std::string& wkt);

/// "plane z = 0, slope 0 0", "raster /data/quarry.tif".
std::string terrain_text(const io::Terrain& terrain);

/// What it means that a ground's base surface is the surface of another's; empty if it isn't.
std::string beneath_text(const Ground& ground);

}  // namespace soilvdb::tools
