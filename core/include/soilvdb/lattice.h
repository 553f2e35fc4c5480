// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where voxels lie in the world, so that any two states of a site can be compared.
#pragma once

#include <optional>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// The origin for a ground near a place: the next multiple of kLatticePeriod voxels along each
/// axis.
///
/// Voxels of one size then lie on one lattice whatever place was asked for, centres at multiples of
/// their size in the world, and have the same sample points. Places within half a period of it have
/// indices that floats hold to 1/256 of a voxel.
Vec3 lattice_origin(double voxel_size_m, const Vec3& near_m);

/// What has to be added to an index of `b` to get that of the same voxel in `a`; nothing if their
/// voxels are not of one lattice, or too far apart for an index.
std::optional<Coord3> lattice_shift(const Ground& a, const Ground& b);

}  // namespace soilvdb::inline v0
