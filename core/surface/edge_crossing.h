// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The crossing of the surface with the edge between two voxel centres.
#pragma once

#include <cstdint>

#include "core/cell/cell_models.h"
#include "core/surface/sheet_vertex.h"

namespace soilvdb::inline v0 {

/// Crossing of the edge from a voxel along an axis, in voxels from that voxel's centre, and the
/// normal there, by the models of its ends; half-way if these have no plane.
/// @param soil by voxel of the models' grid: its centre is in soil; the edge's ends must differ
Crossing edge_crossing(const CellModels& models, const std::uint8_t* soil, int id, int axis);

}  // namespace soilvdb::inline v0
