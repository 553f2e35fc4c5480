// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How much soil a model puts into its cell.
#pragma once

#include "core/cell/cell_model.h"

namespace soilvdb::inline v0 {

struct CellVolume {
  float soil;     ///< in the unit cell, voxels
  float surface;  ///< area in it, voxels: how fast the soil grows as the planes move out
};

/// Exact for one plane, to 0.01 rms where planes meet.
/// @param voxel the cell's place in the lattice
CellVolume cell_volume(const CellModel& model, const Coord3& voxel);

}  // namespace soilvdb::inline v0
