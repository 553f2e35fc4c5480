// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A world lattice of voxels, so that two states of a site can be compared.
#pragma once

#include <optional>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// The origin of a ground near a place: the nearest multiple of kLatticePeriod voxels per axis.
///
/// Voxels of one size then lie on one lattice for any place: their centres are at multiples of
/// their size in the world, with the same sample points. Places within half a period of the origin
/// have indices that floats resolve to 1/256 of a voxel.
Vec3 lattice_origin(double voxel_size_m, const Vec3& near_m);

/// The shift from an index of `b` to the index of the same voxel in `a`; std::nullopt if the voxels
/// are not on one lattice or too far apart for an index.
std::optional<Coord3> lattice_shift(const Ground& a, const Ground& b);

}  // namespace soilvdb::inline v0
