// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A block of ground cut out of the site as a closed level set, which is what a view shows.
#pragma once

#include <openvdb/openvdb.h>

#include "io/draw/relief.h"

namespace soilvdb::inline v0::io {

/// A level set of the ground from its heights, flat below and at the sides; where there is no
/// ground the block has a hole. Undercuts are lost: for sites too large for their voxels.
/// @param relief of square cells, one voxel each
/// @param bottom_m height of the underside, m above the relief's datum
/// @param origin taken from world coordinates to get those of the grid's transform
openvdb::FloatGrid::Ptr cutout_of_heights(const Relief& relief, double bottom_m,
                                          const Vec3& origin);

}  // namespace soilvdb::inline v0::io
