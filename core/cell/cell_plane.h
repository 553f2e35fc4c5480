// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The plane through a cell that its samples and those around it show.
#pragma once

#include <cmath>

#include "core/cell/cell_grid.h"
#include "core/constants.h"

namespace soilvdb::inline v0 {

/// Soil is where n . p < d, p in voxels from the centre of the cell; n is a unit vector.
struct CellPlane {
  float nx = 0, ny = 0, nz = 1, d = 0;

  float along(float x, float y, float z) const { return nx * x + (ny * y + nz * z); }
  /// Signed distance of a point, negative in soil.
  float signed_distance(float x, float y, float z) const { return along(x, y, z) - d; }
  /// The same plane seen from the cell that is so many voxels away.
  CellPlane from(int x, int y, int z) const {
    return {nx, ny, nz,
            d - along(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z))};
  }
  /// Half the width of a cell along n: how far the plane may be from the centre of a cell it meets.
  float half_range() const { return (std::abs(nx) + std::abs(ny) + std::abs(nz)) / 2; }
};

/// Makes the normal's length 1. @return false if it has none; then the plane stays
inline bool normalise(CellPlane& p) {
  const float square = p.nx * p.nx + (p.ny * p.ny + p.nz * p.nz);
  if (!(square > kMinNormalSquare)) return false;
  const float scale = 1 / std::sqrt(square);
  p.nx *= scale;
  p.ny *= scale;
  p.nz *= scale;
  p.d *= scale;
  return true;
}

/// Two unit vectors that make a right-handed frame with n (Duff et al. 2017).
struct Tangents {
  float u[3], v[3];
  explicit Tangents(const CellPlane& p);
};

/// Tilts and shifts a plane by the least-squares displacement: a h = b, where a are the moments of
/// (1, u, v) over places on the plane, its upper half by rows, and b 64 times those of the
/// displacement there. No part of h is larger than `most`.
void displace(CellPlane& plane, const Tangents& t, const float* a, const float* b, float most);

/// A fit and how good it is.
struct PlaneFit {
  CellPlane plane;
  bool smooth = false;        ///< the 27 cells around show nothing but this plane
  bool one_sided = false;     ///< they do within half a voxel of it, as on the face of a thin wall
  CellPlane opposite;         ///< of a wall or slot as thin as the cell: its other face
  bool has_opposite = false;  ///< there is one
};

/// Fits a plane to the words of the 27 cells around a cell: from the counts where columns go from
/// soil to air, then Gauss-Newton steps driven by the samples that a plane has wrong.
///
/// Where a plane is all there is, its normal is within 0.4 degrees rms and its position within
/// 0.006 voxel. A curved surface is fitted 3/8 of (k1 + k2) too far inwards.
PlaneFit fit_plane(const CellGrid& grid, int id);

}  // namespace soilvdb::inline v0
