// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Volume below the marching-cubes surface in one cell, for each of the 256 cases.
#pragma once

#include <array>

namespace soilvdb::bench {

/// Fraction of the unit cell that is soil, by case. Bit i of the case is corner (i & 1, i >> 1 & 1,
/// i >> 2). Vertices of the surface sit at edge midpoints; on a face with two soil corners opposite
/// each other the two are kept apart, which makes neighbouring cells fit.
const std::array<double, 256>& marching_cubes_volumes();

}  // namespace soilvdb::bench
