// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Signed distance from the polygons of a contour.
#pragma once

#include "core/dual_contour.h"

namespace soilvdb {

/// Voxels between a voxel and the lower end of the edge of any polygon within the band around it:
/// the band's three and a polygon's reach.
inline constexpr int kPolygonsSeen = 4;

/// phi at the voxel centres of a chunk: to the nearest of the polygons within the band, all of
/// which are looked at, so that their order is no matter. Where the nearest is of untouched ground
/// and the base surface agrees it is the base surface's own distance.
/// @param contour with reach kPolygonsSeen + 1
void contour_distance(const Soil& soil, const CellModels& models, const Contour& contour,
                      const Coord3& chunk, float* phi_m);

}  // namespace soilvdb
