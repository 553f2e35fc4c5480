// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground from a .vdb of another program, or one that `soilvdb export` wrote.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "soilvdb/initial_terrain.h"
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {

/// Name of the default grid: that of snapshots and of `soilvdb export`.
inline constexpr const char* kSurfaceGrid = "surface";

struct LevelSetInput {
  std::shared_ptr<const InitialTerrain> surface;
  Eigen::AlignedBox3d bounds;  ///< of the narrow band, world, m
  std::string crs_wkt;         ///< empty: unknown
  std::string grid;            ///< name of the grid if the file has other level sets, else empty
};

/// Metadata of a grid: world coordinates of the origin of its transform (Vec3d, m), and its CRS
/// (WKT).
inline constexpr const char* kOriginKey = "soilvdb_origin";
inline constexpr const char* kCrsKey = "soilvdb_crs";

/// Reads the float level set of this name; without a name `surface`, or else the only one.
///
/// Caveat: OpenVDB trusts the bytes that it parses. Read files of unknown origin only where a crash
/// does no harm.
/// @throw InputError if there is no such grid, if several fit and no name is given, if the file
///        can't be read, or if the grid is rotated or stretched, is not closed, or has values that
///        are no distances.
LevelSetInput read_level_set(const std::filesystem::path& file, const std::string& grid = "");

}  // namespace soilvdb::inline v0::io
