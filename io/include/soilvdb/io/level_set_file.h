// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground from a .vdb of another program, or one that `soilvdb export` wrote for others.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "soilvdb/initial_terrain.h"
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {

/// Name of the grid that comes first: that of snapshots and of what `soilvdb export` writes.
inline constexpr const char* kSurfaceGrid = "surface";

struct LevelSetInput {
  std::shared_ptr<const InitialTerrain> surface;
  Eigen::AlignedBox3d bounds;  ///< of its narrow band, world
  std::string crs_wkt;         ///< empty: not known
  std::string grid;            ///< its name, where the file has other level sets, too; else empty
};

/// Metadata of a grid: world coordinates of the origin its transform is relative to (Vec3d, m), and
/// its CRS (WKT).
inline constexpr const char* kOriginKey = "soilvdb_origin";
inline constexpr const char* kCrsKey = "soilvdb_crs";

/// Reads the float level set of this name; without a name `surface`, or else the only one.
///
/// Caveat: OpenVDB trusts the bytes it parses. Call it on files of unknown provenance only where a
/// crash does no harm.
/// @throw InputError if there is no such grid, or several without a name to choose by, if it can't
/// be read, is turned or stretched, its values
///        make no sense as distances, or it is not closed.
LevelSetInput read_level_set(const std::filesystem::path& file, const std::string& grid = "");

}  // namespace soilvdb::inline v0::io
