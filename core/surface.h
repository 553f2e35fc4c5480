// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground's surface, made from occupancy when somebody looks.
#pragma once

#include <optional>

#include "core/soil.h"

namespace soilvdb {

/// Signed distance (m, negative in soil, clamped to +-band) at the 8x8x8 voxel centres of a chunk,
/// made from occupancy. Where the cells near are the base surface's, it is the base's own.
void surface_distance(const Soil& soil, const Coord3& chunk_origin, float* phi_m);

/// Height of the topmost soil at (x, y) of the world, m; nothing where the terrain has none.
std::optional<double> surface_height(const Soil& soil, double x, double y);

}  // namespace soilvdb
