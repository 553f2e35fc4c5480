// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One patch of a height field, bilinear between four posts, for the eight voxels of a row.
#pragma once

#include <array>
#include <cstdint>

#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {

/// A patch over [0, dx] x [0, dy], heights z00 (0, 0), z10 (dx, 0), z01 and z11, m.
struct BilinearPatch {
  double dx, dy;
  double z00, z10, z01, z11;
};

/// The points (x, y, z + k step), k = 0 to 7, over a height field, m.
struct PointRow {
  double x, y, z, step;
  double ground;  ///< height of the field at (x, y); NaN without one
  double slope;   ///< largest slope of the field nearby
};

/// Lowers `best` to the distances from the points of a row to a patch with corner (x0, y0), unless
/// they are certainly larger. Gauss-Newton on the patch starts below each point and stays in the
/// patch. Each iterate is a point of the patch, so a result is never too small. All m.
void nearest_on_patch(const BilinearPatch& patch, double x0, double y0, const PointRow& row,
                      std::array<float, kChunkSide>& best);

/// Bit i is set if point i of a cell lies below a + b x + c y + d x y, in units of the cell.
std::uint64_t points_below(const CellPoints& points, float a, float b, float c, float d);

}  // namespace soilvdb::inline v0
