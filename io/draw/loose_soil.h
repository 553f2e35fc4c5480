// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Loose soil: where it is, and its colour, as clods.
#pragma once

#include "io/draw/canvas.h"
#include "soilvdb/ground.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

/// Loose share of the soil about a point of the world, in [0, 1]: trilinear between the eight cells
/// around it. Thread-safe.
double looseness(const Ground& ground, const Vec3& point);

/// Side of a clod that is visible in a picture of ground of this size, m; at least a voxel.
double clod_m(double picture_m, double voxel_size_m);

/// The colour of loose soil at a point: each clod is a little lighter or darker, with shade around
/// it.
/// @param loose loose share of the soil there. A third already shows full clods, because a layer
///        thinner than a voxel has no more.
Rgb as_loose(const Rgb& color, const Vec3& point, double clod_m, double loose);

}  // namespace soilvdb::inline v0::io
