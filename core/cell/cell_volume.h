// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The volume of soil of a model in its cell.
#pragma once

#include "core/cell/cell_model.h"

namespace soilvdb::inline v0 {

struct CellVolume {
  float soil;     ///< in the unit cell, voxels
  float surface;  ///< area in the cell, voxels: growth of the soil per outward shift
};

/// Exact for one plane; within 0.01 rms where planes meet.
/// @param voxel the cell's place in the lattice
CellVolume cell_volume(const CellModel& model, const Coord3& voxel);

}  // namespace soilvdb::inline v0
