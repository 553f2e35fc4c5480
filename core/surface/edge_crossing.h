// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where the surface crosses the edge between two voxel centres.
#pragma once

#include <cstdint>

#include "core/cell/cell_models.h"
#include "core/surface/sheet_vertex.h"

namespace soilvdb::inline v0 {

/// Crossing of the edge from a voxel along an axis, in voxels from that voxel's centre, and the
/// normal there: what the models of its ends say, half-way where they say nothing.
/// @param soil for each voxel of the models' grid whether its centre is in soil; the edge's ends
/// differ
Crossing edge_crossing(const CellModels& models, const std::uint8_t* soil, int id, int axis);

}  // namespace soilvdb::inline v0
