// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Indices of voxels, and of the chunks and blocks that they are in.
#pragma once

#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {

/// A coordinate of the first voxel of the cube that a voxel is in; cubes tile the world, with sides
/// that are a power of two.
inline int floor_to(int voxel, int side) { return voxel & ~(side - 1); }
/// All coordinates of it.
template <typename Voxel>
typename Voxel::PlainObject floor_to(const Eigen::MatrixBase<Voxel>& voxel, int side) {
  return voxel.unaryExpr([side](int v) { return floor_to(v, side); });
}

/// Number of a voxel's cell in its chunk, that of its word.
inline int cell_number(const Coord3& voxel) {
  constexpr int kMask = kChunkSide - 1;
  return ((voxel.x() & kMask) * kChunkSide + (voxel.y() & kMask)) * kChunkSide +
         (voxel.z() & kMask);
}
/// The voxel with that number, less its chunk's first one.
inline Coord3 numbered_voxel(int n) { return {n >> 6, n >> 3 & 7, n & 7}; }

/// The steps from a voxel or chunk to the 27 around it, itself among them, by x, then y, then z.
inline Coord3 step_around(int n) { return {n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1}; }

}  // namespace soilvdb::inline v0
