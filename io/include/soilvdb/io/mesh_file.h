// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Meshes of ground, for other programs, and meshes of tools.
#pragma once

#include <filesystem>
#include <string>

#include "soilvdb/mesher.h"

namespace soilvdb::inline v0::io {

/// Writes a mesh in local coordinates, atomically; the suffix selects PLY (binary), OBJ, STL
/// (binary) or GLB. Vertices and triangles keep their order, except in STL, which shares no
/// vertices. The site's origin and CRS are comments in PLY and OBJ, `asset.extras` in GLB, and the
/// header in STL (80 bytes, the origin alone). GLB is y up, as its specification demands: its x, y,
/// z are x, z, -y of the site.
/// @throw std::runtime_error naming the file and the cause; std::invalid_argument for an unknown
///        suffix or a mesh without triangles.
void write_mesh(const std::filesystem::path& file, const Mesh& mesh, const Vec3& origin,
                const std::string& crs_wkt);

/// Reads all triangles of an STL or OBJ file in its own coordinates, or of the scene of a COLLADA
/// file (.dae) in metres by its unit and in its axes. Merges points with equal coordinates. Faces
/// with more than three corners must be convex.
/// @throw InputError if the file can't be read, has no triangles, or has a point that is not finite
Mesh read_mesh(const std::filesystem::path& file);

}  // namespace soilvdb::inline v0::io
