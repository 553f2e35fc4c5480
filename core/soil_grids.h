// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground as OpenVDB grids. Slow to compile: include it only where a grid is needed.
#pragma once

#include <openvdb/openvdb.h>

#include "core/soil.h"

namespace soilvdb {

/// Owns the leaves of the resident ground.
class SoilGrids {
 public:
  SoilGrids(double voxel_size_m, double band_m);

  /// The resident ground: class level set, background +band, leaves only. World coordinates of the
  /// grid's transform are relative to Soil::origin(). Active where |phi| < band.
  openvdb::FloatGrid& surface() { return *surface_; }
  const openvdb::FloatGrid& surface() const { return *surface_; }

 private:
  openvdb::FloatGrid::Ptr surface_;
};

/// Base surface from a closed level set: trilinear between its voxels.
/// @param origin added to the grid's own world coordinates
/// @throw std::invalid_argument unless the grid is a level set with a uniform scale.
std::unique_ptr<BaseSurface> make_level_set_surface(openvdb::FloatGrid::ConstPtr grid,
                                                    const Vec3& origin);

/// A closed level set of the ground inside a box of the world, for other programs: cut off at the
/// box's sides and bottom, transform relative to Soil::origin().
openvdb::FloatGrid::Ptr closed_level_set(const Soil& soil, const Eigen::AlignedBox3d& box);

}  // namespace soilvdb
