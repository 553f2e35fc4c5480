// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numbers and names in the program's output for people.
#pragma once

#include <cstdint>
#include <string>

#include "soilvdb/io/site.h"

namespace soilvdb::tools {

/// Prints a line to standard error, "soilvdb: " first, without control characters, which quoted
/// names may hold. A failure to print is ignored.
void say(std::string line);

/// Four significant digits without an exponent: "0.03927", "1234.5".
std::string number(double value);

/// A length without rounding errors: "0.208" for 0.20800000000000002.
std::string length_text(double length_m);

/// "12.3 MB", by powers of 1000.
std::string bytes(double count);

/// "from 1, 2 to 3, 4", in whole metres.
std::string extent_text(const Eigen::AlignedBox2d& box);

/// A time for file names and messages, to a microsecond, without trailing zeros: "12.5".
std::string time_text(double seconds);

/// "1 update", "2 updates".
std::string counted(std::uint64_t count, const std::string& noun);

/// "EPSG:26918", or a phrase for an unknown CRS.
std::string crs_text(const std::string& wkt);

/// "plane z = 0, slope 0 0", "raster /data/quarry.tif".
std::string terrain_text(const io::Terrain& terrain);

/// A phrase for a base surface that is another ground's surface; empty for other bases.
std::string beneath_text(const Ground& ground);

}  // namespace soilvdb::tools
