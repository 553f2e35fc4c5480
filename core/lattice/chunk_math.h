// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Indices of voxels and of their chunks and blocks.
#pragma once

#include <cmath>

#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {

/// A coordinate of the first voxel of a voxel's cube. Cubes with a power of two as side tile the
/// world.
inline int floor_to(int voxel, int side) { return voxel & ~(side - 1); }
/// All its coordinates.
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
/// The voxel with a number, relative to its chunk's first voxel.
inline Coord3 numbered_voxel(int n) { return {n >> 6, n >> 3 & 7, n & 7}; }

/// Steps from a voxel or chunk to its 26 neighbours and itself, by x, then y, then z.
inline Coord3 step_around(int n) { return {n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1}; }

/// A place in plan as a key, as of the lowest cell of a column of chunks.
inline std::uint64_t plan_key(const Coord2& cell) {
  return std::uint64_t{static_cast<std::uint32_t>(cell.x())} << 32 |
         static_cast<std::uint32_t>(cell.y());
}
struct PlanHash {
  std::size_t operator()(std::uint64_t key) const { return key * 0x9e3779b97f4a7c15u >> 20; }
};

/// The cell that a height or place of index space is in.
inline int cell_of(double at) { return static_cast<int>(std::floor(at + 0.5)); }

}  // namespace soilvdb::inline v0
