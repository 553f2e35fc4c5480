// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How much soil came and went above each cell of a raster, counted on samples.
#pragma once

#include <vector>

#include "core/soil.h"

namespace soilvdb {

/// For each cell of a raster the soil there now less that of the base surface, as a height: volume
/// over area, m. 0 where the ground isn't resident. Row-major from low y to high y.
///
/// Guarantee: the sum of height times area over a raster that covers all changes is what the ledger
/// books (Soil::change_m3) to rounding, whatever the size of its cells. The soil of a voxel's
/// column is spread evenly over it, so a cell that is made of whole columns holds exactly theirs,
/// and any other holds a share by area. Caveat: it is soil added and removed, not the height of
/// what is on top: under an overhang the raster is lowered by the hollow, as if the roof had come
/// down into it. A raster has one height for a place; this is the one that keeps the volume.
/// @param grid of cell middles; cells of grid.spacing
std::vector<double> column_change_m(const Soil& soil, const HeightGrid& grid);

}  // namespace soilvdb
