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

/// A leaf of 512 values of phi, m, active where |phi| < band.
std::unique_ptr<FloatLeaf> level_set_leaf(const Coord3& origin, const float* phi_m, float band_m);

/// The ground as level set grid `surface` with background +band, active where |phi| < band. It has
/// a leaf for each given chunk that is resident or near a cut. The transform is relative to
/// Ground::origin().
openvdb::FloatGrid::Ptr surface_grid(const Ground& ground, std::span<const Coord3> chunks);

/// Origins of the resident chunks and of the neighbours that a cut's band may reach.
std::vector<Coord3> chunks_with_surface(const Ground& ground);

/// A grid like surface_grid() without leaves.
openvdb::FloatGrid::Ptr empty_surface_grid(const Ground& ground);

/// Base surface from a closed level set, trilinear between its voxels.
/// @param origin world position of the grid's own world origin, m
/// @throw std::invalid_argument unless the grid is a level set with a uniform scale
std::unique_ptr<InitialTerrain> make_level_set_surface(openvdb::FloatGrid::ConstPtr grid,
                                                       const Vec3& origin);

/// A tool from a closed level set; the grid's world is the tool frame.
/// @throw std::invalid_argument unless it is a level set with cubic voxels, at most 2^27 in total
ToolShape make_tool_shape(const openvdb::FloatGrid& grid);

/// Soil fraction, 0 to 1, of each voxel centred in a box of the world: fog volume `occupancy`,
/// background 0, active where a voxel holds soil. The transform is relative to Ground::origin().
/// @throw std::invalid_argument if the box is too large at this voxel size
openvdb::FloatGrid::Ptr occupancy_grid(const Ground& ground, const Eigen::AlignedBox3d& box);

/// A closed level set of the ground inside a box of the world, cut off at the box's sides and
/// bottom; the transform is relative to Ground::origin(). @throw std::invalid_argument if the box
/// is too large
openvdb::FloatGrid::Ptr closed_level_set(const Ground& ground, const Eigen::AlignedBox3d& box);

}  // namespace soilvdb::inline v0
