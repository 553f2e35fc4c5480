// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil over hollows: overhangs that are too long for what holds them, and what hangs on nothing.
#pragma once

#include <cstdint>
#include <vector>

#include "core/settle/ground_window.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// How far soil stands out over a hollow.
struct OverhangStrength {
  double shear = 0;    ///< cohesion over unit weight, cells: longest overhang of any thickness
  double bending = 0;  ///< tensile strength over three times the unit weight, cells: an overhang of
                       ///< thickness t stands to sqrt(bending * t)
};

/// Soil of one column that nothing holds.
struct UnsupportedPiece {
  Coord2 cell;
  int low, high;             ///< cells that it fills, none else in between
  int ground;                ///< topmost cell with soil below it
  std::int64_t bank, loose;  ///< samples
};

/// What falls in a box of cells: what isn't connected to the ground, and overhangs of bank soil
/// that reach out farther from a column that has ground below than their strength allows (a beam
/// held at one end: min(shear, sqrt(bending * thickness))). All falls that hangs on the same
/// column.
///
/// Bank is connected where columns that are neighbours have some in the same cells of z; loose soil
/// holds nothing. What comes to the bottom of the box stands on ground.
/// @param strength null: bank that is connected stands
/// What may be beyond the box, where something hangs that stands therefore.
struct BoundaryContact {
  bool holds = false;   ///< bank at a side that nothing else holds
  bool ground = false;  ///< what it would fall to
};
std::vector<UnsupportedPiece> find_overhangs(const Ground& ground, const Eigen::AlignedBox3i& cells,
                                             const OverhangStrength* strength,
                                             BoundaryContact& contact);

}  // namespace soilvdb::inline v0
