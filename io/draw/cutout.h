// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A block of ground, cut out of the site as a closed level set, for views.
#pragma once

#include <openvdb/openvdb.h>

#include "io/draw/relief.h"

namespace soilvdb::inline v0::io {

/// A level set of the ground from its heights, with a flat underside and flat sides. Where there is
/// no ground the block has a hole. Undercuts are lost: use it for sites too large for voxels.
/// @param relief with square cells, one voxel each
/// @param bottom_m height of the underside, m above the relief's datum
/// @param origin world coordinates of the origin of the grid's transform, m
openvdb::FloatGrid::Ptr cutout_of_heights(const Relief& relief, double bottom_m,
                                          const Vec3& origin);

}  // namespace soilvdb::inline v0::io
