// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that stands too steep comes down, on ground given as heights of columns.
#pragma once

#include <cstdint>
#include <vector>

#include "core/constants.h"

namespace soilvdb::inline v0 {

/// Square columns of ground, row by row: column (x, y) is entry y * nx + x of each list. From
/// below: what stands however steep it is up to `base_m`, bank soil that failed up to `bank_m`,
/// loose soil up to `top_m`. base_m <= bank_m <= top_m, heights in any frame.
struct SoilColumns {
  int nx = 0, ny = 0;
  double side_m = 0;
  std::vector<double> base_m, bank_m, top_m;
  /// Columns that aren't there: they give and take nothing, and what lies beside them leans on them
  /// as on a wall. So is all beyond the grid. Their heights are never read. Empty: all are there.
  std::vector<std::uint8_t> missing;
};

struct Repose {
  double slope = 0;  ///< tangent of the angle of repose, > 0
  double swell = 1;  ///< loose volume over bank volume, >= 1
};

struct Collapse {
  std::vector<double> top_m;   ///< of each column; to the bit as it was where nothing moved
  std::vector<double> bank_m;  ///< what is above, and wasn't before, is loose
  int iterations = 0;          ///< on the columns themselves; 0: nothing was too steep
  bool at_edge = false;  ///< soil came to or left the grid's outermost columns: it was too small
};

/// The ground after all that is too steep came to rest: heights nearest to the old ones, in the
/// metric in which moved bank soil counts with its swell, among those no steeper than repose whose
/// soil has the same mass. That is where soil goes which slides down the steepest way, without
/// inertia (Dumont and Igbida 2009, the collapse of sandpiles; Prigozhin 1996 for steep support).
/// Soil that lies on support steeper than repose slides to its foot; what the support holds back
/// behind a brink stays.
///
/// Guarantees: mass is conserved to rounding; no soil comes from where there is none, and none goes
/// below the base; the same bits for any number of threads, build and CPU; grids mirrored or turned
/// give mirrored or turned heights (to 0.1 sides where a side can't be halved evenly until less
/// than kMinColumnsToCoarsen columns are left). A ground at rest is returned as it is. Where
/// support is no steeper than repose, slopes are within kRestToleranceRad of it, so that collapsing
/// twice is collapsing once, and heights within about 0.1 column sides (0.02 rms) of the exact
/// projection.
///
/// Caveats: where soil could run either way over a brink, the grid's directions decide. Soil
/// thinner than what a slope drops across a column may stay on brinks, however steep. Where soil
/// runs over a steep brink at an angle to the grid, it comes to rest in several goes of
/// kMaxFluxSteps, and is 0.2 to 0.8 side root mean square from the truth on the slope that ends
/// there: columns that a brink cuts are only means. kMaxCollapseTries may end it before.
///
/// Uses the caller's TBB arena. 96 x 96 columns take 2 to 20 ms, 60 where it takes all tries.
Collapse collapse(const SoilColumns& columns, const Repose& repose);

}  // namespace soilvdb::inline v0
