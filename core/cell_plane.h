// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The plane through a cell that its samples and those around it show.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include "core/affine.h"
#include "core/cell_grid.h"
#include "core/lanes.h"

namespace soilvdb {

/// Soil is where n . p < d, p in voxels from the centre of the cell; n is a unit vector.
struct CellPlane {
  float nx = 0, ny = 0, nz = 1, d = 0;

  float along(float x, float y, float z) const { return nx * x + (ny * y + nz * z); }
  /// Signed distance of a point, negative in soil.
  float beyond(float x, float y, float z) const { return along(x, y, z) - d; }
  /// The same plane seen from the cell that is so many voxels away.
  CellPlane from(int x, int y, int z) const {
    return {nx, ny, nz,
            d - along(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z))};
  }
  /// Half the width of a cell along n: how far the plane may be from the centre of a cell it meets.
  float reach() const { return (std::abs(nx) + std::abs(ny) + std::abs(nz)) / 2; }
};

/// Samples within this of a plane that passes by a cell aren't asked one by one, voxels.
inline constexpr float kFaceMargin = 0.04f;

/// Rows to columns in a square of 8 x 8 bits (Warren, Hacker's Delight 7-3).
SOILVDB_INLINE std::uint64_t transpose(std::uint64_t b) {
  std::uint64_t t = (b ^ b >> 7) & 0x00aa00aa00aa00aau;
  b ^= t ^ t << 7;
  t = (b ^ b >> 14) & 0x0000cccc0000ccccu;
  b ^= t ^ t << 14;
  t = (b ^ b >> 28) & 0x00000000f0f0f0f0u;
  return b ^ t ^ t << 28;
}

/// Which samples of the cell a plane has in soil. `d` is from that cell's centre.
SOILVDB_INLINE std::uint64_t plane_mask(const CellPoints& points, const CellPlane& p) {
  const Lanes nx = all_lanes(p.nx), ny = all_lanes(p.ny), nz = all_lanes(p.nz);
  const Lanes d = all_lanes(p.d + (p.nx + p.ny + p.nz) / 2);
  LaneMask rows = {};
  for (int k = 0; k < kLeafSide; ++k) {
    Lanes x, y, z;
    __builtin_memcpy(&x, points.x + kLeafSide * k, sizeof(x));
    __builtin_memcpy(&y, points.y + kLeafSide * k, sizeof(y));
    __builtin_memcpy(&z, points.z + kLeafSide * k, sizeof(z));
    rows |= (nx * x + (ny * y + nz * z) < d) & (1 << k);
  }
  // Bit k of lane j is point 8 k + j.
  using Bytes = std::uint8_t __attribute__((vector_size(kLeafSide)));
  const Bytes bytes = __builtin_convertvector(rows, Bytes);
  std::uint64_t square;
  __builtin_memcpy(&square, &bytes, sizeof(square));
  return transpose(square);
}

/// Two unit vectors that make a right-handed frame with n (Duff et al. 2017).
struct Tangents {
  float u[3], v[3];
  explicit Tangents(const CellPlane& p);
};

/// A fit and how good it is.
struct PlaneFit {
  CellPlane plane;
  bool smooth = false;  ///< the 27 cells around show nothing but this plane
  bool sided = false;   ///< they do within half a voxel of it, as on the face of a thin wall
};

/// Fits a plane to the words of the 27 cells around a cell: from the counts where columns go from
/// soil to air, then Gauss-Newton steps driven by the samples that a plane has wrong.
///
/// Where a plane is all there is, its normal is within 0.4 degrees rms and its position within
/// 0.006 voxel. A curved surface is fitted 3/8 of (k1 + k2) too far inwards.
PlaneFit fit_plane(const CellGrid& grid, int id);

/// Offset of the surface from a plane fitted to 27 cells, along n, voxels, for a trace of
/// curvature.
inline constexpr float kWindowBend = 0.375f;

}  // namespace soilvdb
