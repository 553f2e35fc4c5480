// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground as OpenVDB grids. Slow to compile: include it only where a grid is needed.
#pragma once

#include <openvdb/openvdb.h>

#include <span>
#include <vector>

#include "soilvdb/ground.h"
#include "soilvdb/tool_shape.h"

namespace soilvdb::inline v0 {

using FloatLeaf = openvdb::FloatTree::LeafNodeType;

/// 512 values of phi as a leaf, active where |phi| < band.
std::unique_ptr<FloatLeaf> level_set_leaf(const Coord3& origin, const float* phi_m, float band_m);

/// Ground as a grid `surface`: class level set, background +band, a leaf for each of some chunks
/// but for those that aren't resident and near no cut; active where |phi| < band. Its transform is
/// relative to Ground::origin().
openvdb::FloatGrid::Ptr surface_grid(const Ground& ground, std::span<const Coord3> chunks);

/// The resident chunks, and those around them into which a cut's band may reach.
std::vector<Coord3> chunks_with_surface(const Ground& ground);

/// A grid like that without leaves.
openvdb::FloatGrid::Ptr empty_surface_grid(const Ground& ground);

/// Base surface from a closed level set: trilinear between its voxels.
/// @param origin added to the grid's own world coordinates
/// @throw std::invalid_argument unless the grid is a level set with a uniform scale.
std::unique_ptr<InitialTerrain> make_level_set_surface(openvdb::FloatGrid::ConstPtr grid,
                                                       const Vec3& origin);

/// A tool from a closed level set; the grid's world is the tool's frame.
/// @throw std::invalid_argument unless it is a level set with cubic voxels, of at most 2^27 in all
ToolShape make_tool_shape(const openvdb::FloatGrid& grid);

/// How much of each voxel whose centre is in a box of the world is soil, 0 to 1: grid `occupancy`,
/// class fog volume, background 0, a voxel active where it holds soil. Its transform is relative to
/// Ground::origin().
/// @throw std::invalid_argument if the box is too large at this voxel size
openvdb::FloatGrid::Ptr occupancy_grid(const Ground& ground, const Eigen::AlignedBox3d& box);

/// A closed level set of the ground inside a box of the world, for other programs: cut off at the
/// box's sides and bottom, transform relative to Ground::origin().
openvdb::FloatGrid::Ptr closed_level_set(const Ground& ground, const Eigen::AlignedBox3d& box);

}  // namespace soilvdb::inline v0
