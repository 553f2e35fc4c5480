// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The mesh of cell models: a vertex in every dual cell that the surface runs through, on the planes
// of the models, a polygon around every edge of the grid of voxel centres that it crosses.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/cell/cell_models.h"

namespace soilvdb::inline v0 {

/// A vertex, in voxels from the first voxel of the grid.
struct ContourVertex {
  Coord3 cell;  ///< of the dual cell: the voxel at its low corner
  float in[3];  ///< from that voxel's centre
  bool base;    ///< made of undug cells alone
};

struct Contour {
  std::vector<ContourVertex> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counter-clockwise seen from the air
  /// Of each triangle: the cell at the lower end of the edge it goes round.
  std::vector<int> edges;
};

/// Dual contouring (Ju et al. 2002) with a vertex for each sheet of the surface in a dual cell, so
/// that sheets which come close don't touch. Signs are those of voxel centres; in an ambiguous face
/// the models decide its middle.
///
/// Guarantees: no edge has more than two triangles; edges with one are where the chunks asked for
/// end; the vertices and triangles about an edge of the grid depend on the models of the voxels
/// around it alone. Polygons belong to the chunk of the lower end of the edge that they go round,
/// or to that of the upper one if only that is resident.
/// @param range 0: the polygons of the chunks asked for; else all that lie nearer than so many
/// voxels to them, whatever is resident
Contour contour(const CellModels& models, int range);

}  // namespace soilvdb::inline v0
