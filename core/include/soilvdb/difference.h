// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Cut and fill between two states of a site.
#pragma once

#include <vector>

#include "soilvdb/ground.h"
#include "soilvdb/volume_changes.h"

namespace soilvdb::inline v0 {

struct Difference {
  double cut_m3 = 0, fill_m3 = 0, net_m3 = 0;
  double area_m2 = 0;       ///< plan area of the change
  double error_m3 = 0;      ///< error bound of cut, and of fill
  bool exact = false;       ///< compared sample by sample
  Eigen::AlignedBox2d box;  ///< bounds of the changed columns, world, m
};

/// Compares two grounds of a site.
///
/// Grounds with one lattice and initial terrain are compared sample by sample; volumes are
/// differences of the ledgers. The error is two standard deviations of the counts against the true
/// surfaces.
///
/// Other grounds are compared in boxes as large as the larger voxels. The gain of a box is the
/// difference of both losses against the initial ground below; so the net volume is exact. The
/// error is the sum of two standard deviations of the gain, one for each box whose counts cannot
/// prove a change (these do not cancel), and the volume that one box near both surfaces may hide as
/// cut plus fill.
///
/// core/compare/changed_area.h defines the area.
/// @param same_base whether both have one initial terrain; else the initial terrains must be
/// surfaces of
///        grounds with the same initial ground
Difference difference(const Ground& before, const Ground& after, bool same_base);

/// Compares the soil inside a boundary, for two grounds of one lattice and initial terrain.
/// Boundaries with common edges count each sample once: parts sum to the whole. The area is the
/// boundary's.
/// @param boundary corners in the world, m; the last connects to the first; inside by the even-odd
///        rule
/// @throw std::invalid_argument for grounds of two lattices, or if sides of the boundary cross
Difference difference(const Ground& before, const Ground& after, const std::vector<Vec2>& boundary);

/// Calls `f` with the gain of each changed column of `bins`; a column may occur several times.
void for_each_volume_change(const Ground& before, const Ground& after, bool same_base,
                            const VolumeBins& bins, const VolumeChangeFunction& f);

}  // namespace soilvdb::inline v0
