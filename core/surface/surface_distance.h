// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Signed distance from the polygons of a contour.
#pragma once

#include <vector>

#include "core/surface/dual_contour.h"

namespace soilvdb::inline v0 {

/// phi at voxel centres: the distance to the nearest polygon in the band. All polygons are
/// compared, so their order has no influence. If the nearest polygon is undug and the initial
/// terrain agrees, the distance is the terrain's own.
class ContourDistance {
 public:
  /// @param contour with reach kPolygonsSeen + 1. Models must outlive it.
  ContourDistance(const Ground& ground, const CellModels& models, const Contour& contour);

  /// 512 values for the voxels of a chunk, m.
  void chunk(const Coord3& origin, float* phi_m) const;

  /// A triangle for the kernel, in voxels from the lower end of its edge.
  struct Triangle {
    Coord3 cell;
    float corner[3][3], edge[3][3], inverse_square[3];
    float inwards[3][3];  ///< in the plane, across each edge
    float normal[3], beside;
    float middle[3], radius;  ///< of its bounding ball
    bool base;
  };

 private:
  const Ground& ground_;
  const CellModels& models_;
  std::vector<Triangle> triangles_;  // by columns of the grid
  std::vector<int> first_;           // first triangle of each column, and the end
};

}  // namespace soilvdb::inline v0
