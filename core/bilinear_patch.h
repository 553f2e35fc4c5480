// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One patch of a height field, bilinear between four posts, for the eight voxels of a row.
#pragma once

#include <array>
#include <cstdint>

#include "core/base_surface.h"

namespace soilvdb {

/// A patch over [0, dx] x [0, dy], heights z00 (0, 0), z10 (dx, 0), z01 and z11, m.
struct BilinearPatch {
  double dx, dy;
  double z00, z10, z01, z11;
};

/// Lowers `best` to the distances from the points (x, y, z + k step), k = 0 to 7, to the patch.
/// Gauss-Newton on the patch from the foot below each point, held to the patch; each iterate is a
/// point of it, so a result is never too small. All m.
void nearest_on_patch(const BilinearPatch& patch, double x, double y, double z, double step,
                      std::array<float, kLeafSide>& best);

/// Bit i is set where point i of a cell lies below a + b x + c y + d x y, in units of the cell.
std::uint64_t points_below(const CellPoints& points, float a, float b, float c, float d);

}  // namespace soilvdb
