// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Cuts parts out of a site, for other programs.
#pragma once

#include <cstdint>
#include <filesystem>

#include "soilvdb/ground.h"
#include "soilvdb/io/site.h"
#include "soilvdb/mesher.h"

namespace soilvdb::tools {

/// The triangles of mesh_all() whose centre of gravity is in the box (low sides included), so that
/// regions that tile the plane partition the triangles. Meshes only blocks that reach into the box.
Mesh mesh_region(const Ground& ground, const Eigen::AlignedBox2d& box);

/// The world box over `plan` that holds the ground's surface there with a margin of ten voxels.
Eigen::AlignedBox3d ground_box(const Ground& ground, const Eigen::AlignedBox2d& plan);

/// Writes the ground in the box as a grid for other programs: a closed level set `surface`, or the
/// fill fractions as a fog volume `occupancy`. The site's origin and CRS are metadata. Atomic.
/// @return number of active voxels
/// @throw std::invalid_argument if there is no soil; std::runtime_error naming the file and the
///        cause.
std::uint64_t write_level_set(const std::filesystem::path& file, const io::Site& site,
                              const Eigen::AlignedBox3d& box);
std::uint64_t write_occupancy(const std::filesystem::path& file, const io::Site& site,
                              const Eigen::AlignedBox3d& box);

}  // namespace soilvdb::tools
