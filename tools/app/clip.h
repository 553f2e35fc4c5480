// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Parts of a site, cut out for other programs.
#pragma once

#include <cstdint>
#include <filesystem>

#include "soilvdb/ground.h"
#include "soilvdb/io/site.h"
#include "soilvdb/mesher.h"

namespace soilvdb::tools {

/// The triangles of mesh_all() whose centre of gravity is in the box (low sides included), so that
/// regions which tile the plane share them out. Meshes only the blocks that reach into it.
Mesh mesh_region(const Ground& ground, const Eigen::AlignedBox2d& box);

/// The box over `plan` that holds the surface of the ground there with a margin of ten voxels,
/// world.
Eigen::AlignedBox3d ground_box(const Ground& ground, const Eigen::AlignedBox2d& plan);

/// Writes the ground in the box as a grid for other programs, with the site's origin and CRS as
/// metadata: a closed level set `surface` or, by fill fractions, a fog volume `occupancy`. Atomic.
/// @return its active voxels.
/// @throw std::invalid_argument if there is no soil; std::runtime_error naming the file and the
///        cause.
std::uint64_t write_level_set(const std::filesystem::path& file, const io::Site& site,
                              const Eigen::AlignedBox3d& box);
std::uint64_t write_occupancy(const std::filesystem::path& file, const io::Site& site,
                              const Eigen::AlignedBox3d& box);

}  // namespace soilvdb::tools
