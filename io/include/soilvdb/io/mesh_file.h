// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Meshes for other programs, and of tools.
#pragma once

#include <filesystem>
#include <string>

#include "soilvdb/mesher.h"

namespace soilvdb::inline v0::io {

/// Writes PLY (binary), OBJ, STL (binary) or GLB by the file's suffix, in local coordinates;
/// vertices and triangles keep their order but for STL, which has no vertices to share. The site's
/// origin and CRS stand in the header where the format has a place for them: comments in PLY and
/// OBJ, the header (80 bytes, the origin alone) in STL, `asset.extras` in GLB. GLB is turned y up,
/// as the format demands: its x, y, z are x, z, -y of the site. Atomic.
/// @throw std::runtime_error naming the file and the cause; std::invalid_argument for an unknown
///        suffix or a mesh without triangles.
void write_mesh(const std::filesystem::path& file, const Mesh& mesh, const Vec3& origin,
                const std::string& crs_wkt);

/// Reads all triangles of an STL or OBJ file, in its own coordinates. Points at one place become
/// one; faces of more than three corners must be convex.
/// @throw InputError if it can't be read, has a point that is no number, or no triangles
Mesh read_mesh(const std::filesystem::path& file);

}  // namespace soilvdb::inline v0::io
