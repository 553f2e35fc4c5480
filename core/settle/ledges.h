// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil over hollows: ledges that are too long for what holds them, and what hangs on nothing.
#pragma once

#include <cstdint>
#include <vector>

#include "core/settle/ground_window.h"
#include "soilvdb/soil.h"

namespace soilvdb::inline v0 {

/// How far soil stands out over a hollow.
struct LedgeStrength {
  double shear = 0;    ///< cohesion over unit weight, cells: longest ledge of any thickness
  double bending = 0;  ///< tensile strength over three times the unit weight, cells: a ledge of
                       ///< thickness t stands to sqrt(bending * t)
};

/// Soil of one column that nothing holds.
struct Loosened {
  Coord2 cell;
  int low, high;             ///< cells that it fills, none else in between
  int ground;                ///< topmost cell with soil below it
  std::int64_t bank, loose;  ///< samples
};

/// What falls in a box of cells: what isn't connected to the ground, and ledges of bank soil that
/// reach out farther from a column that has ground below than their strength allows (a beam held at
/// one end: min(shear, sqrt(bending * thickness))). All falls that hangs on the same column.
///
/// Bank is connected where columns that are neighbours have some in the same cells of z; loose soil
/// holds nothing. What comes to the bottom of the box stands on ground.
/// @param strength null: bank that is connected stands
/// What may be beyond the box, where something hangs that stands therefore.
struct BeyondBox {
  bool holds = false;   ///< bank at a side that nothing else holds
  bool ground = false;  ///< what it would fall to
};
std::vector<Loosened> find_ledges(const Soil& soil, const Eigen::AlignedBox3i& cells,
                                  const LedgeStrength* strength, BeyondBox& beyond);

}  // namespace soilvdb::inline v0
