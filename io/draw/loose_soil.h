// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where soil is loose, and how it looks: as clods.
#pragma once

#include "io/draw/canvas.h"
#include "soilvdb/ground.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

/// Share of the soil about a point of the world that is loose, in [0, 1]: of the eight cells around
/// it, weighted as a trilinear interpolation does. Several threads may ask at once.
double looseness(const Ground& ground, const Vec3& point);

/// Side of a clod that can be seen in a picture of ground of this size, m. Never under a voxel.
double clod_m(double picture_m, double voxel_size_m);

/// A colour as it is on loose soil at a point: each clod is a little lighter or darker, with shade
/// around it.
/// @param loose share of the soil there that is loose; with a third of it clods set in, as a layer
///        thinner than a voxel has no more
Rgb as_loose(const Rgb& color, const Vec3& point, double clod_m, double loose);

}  // namespace soilvdb::inline v0::io
