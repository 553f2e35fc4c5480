// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The place of the vertex of a sheet on the planes of its crossings.
#pragma once

#include "core/cell/cell_plane.h"

namespace soilvdb::inline v0 {

/// A crossing of the surface with an edge of the grid, in voxels from a dual cell's low corner, and
/// its normal there.
struct Crossing {
  float p[3];
  float n[3];
};

/// The point of least squared distance to the planes of crossings (quadratic error function), about
/// the mean of the crossings; held to the dual cell [0, 1]^3 and a quarter of a voxel around it.
/// On smooth parts it is offset so that the mesh and the surface hold the same volume.
void place_vertex(const Crossing* crossings, int count, float* at);

}  // namespace soilvdb::inline v0
