// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What was cut and filled between two states of a site.
#pragma once

#include <vector>

#include "soilvdb/ground.h"
#include "soilvdb/volume_changes.h"

namespace soilvdb::inline v0 {

struct Difference {
  double cut_m3 = 0, fill_m3 = 0, net_m3 = 0;
  double area_m2 = 0;       ///< plan area of what changed
  double error_m3 = 0;      ///< by which cut and fill may be wrong, each
  bool exact = false;       ///< counted sample by sample
  Eigen::AlignedBox2d box;  ///< of the columns that changed, world
};

/// Compares two grounds of a site.
///
/// Where their voxels are of one lattice and their base surfaces the same, sample by sample:
/// volumes are differences of the ledgers, and the error is two standard deviations of what counts
/// of samples err by against the true surfaces.
///
/// Else box by box, as large as the larger voxels: what one of them gained is the difference of
/// what the two have lost there against the ground that is under both, so that net is exact. The
/// error is two standard deviations of that, one for each box in which counts can't tell whether
/// anything changed, for those don't cancel, and all that may have been cut and filled within one
/// box where both were near.
///
/// Either way the area is that of core/compare/changed_area.h.
/// @param same_base whether both have one base surface; else those must be surfaces of grounds with
///        the same ground beneath
Difference difference(const Ground& before, const Ground& after, bool same_base);

/// The same of the soil inside a boundary, for two grounds of one lattice and base surface. Each
/// sample is inside one of two boundaries that share an edge, so parts of a site add up to the
/// whole. The area is the boundary's.
/// @param boundary corners in the world, m, closed from the last to the first; inside by even-odd
/// @throw std::invalid_argument where grounds are of two lattices, or sides of the boundary cross
Difference difference(const Ground& before, const Ground& after, const std::vector<Vec2>& boundary);

/// Calls `f` with what columns of any width gained between the two, some of them several times.
void for_each_volume_change(const Ground& before, const Ground& after, bool same_base,
                            const VolumeBins& bins, const VolumeChangeFunction& f);

}  // namespace soilvdb::inline v0
