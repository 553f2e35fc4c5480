// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil over hollows: overhangs that are too long for their support, and soil without support.
#pragma once

#include <cstdint>
#include <vector>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Strength of soil over a hollow.
struct OverhangStrength {
  double shear = 0;    ///< cohesion over unit weight, cells: longest overhang of any thickness
  double bending = 0;  ///< tensile strength over three times the unit weight, cells: an overhang of
                       ///< thickness t stands to sqrt(bending * t)
};

/// Soil of one column without support.
struct UnsupportedPiece {
  Coord2 cell;
  int low, high;             ///< cells that it fills, without gaps
  int ground;                ///< topmost cell with soil below it
  std::int64_t bank, loose;  ///< samples
};

/// Signs that the box is too small: support or ground may be beyond it.
struct BoundaryContact {
  bool holds = false;   ///< bank at a side has no support inside, and stands
  bool ground = false;  ///< soil that falls has no ground below inside
};

/// Finds the soil in a box of cells that falls: soil without connection to the ground, and
/// overhangs of bank that are too long for their strength. An overhang reaches out from a column
/// with ground below, like a beam held at one end, by up to min(shear, sqrt(bending * thickness)).
/// With it falls all soil that hangs on the same column.
///
/// Bank is connected if neighbouring columns have some in the same cells of z; loose soil holds
/// nothing. Soil at the bottom of the box stands on ground.
/// @param strength null: connected bank stands
std::vector<UnsupportedPiece> find_overhangs(const Ground& ground, const Eigen::AlignedBox3i& cells,
                                             const OverhangStrength* strength,
                                             BoundaryContact& contact);

}  // namespace soilvdb::inline v0
