// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The mesh of cell models: a vertex on the models' planes in each dual cell that the surface
// crosses, and a polygon around each crossed edge of the grid of voxel centres.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/cell/cell_models.h"

namespace soilvdb::inline v0 {

/// A vertex, in voxels from the first voxel of the grid.
struct ContourVertex {
  Coord3 cell;  ///< the voxel at the low corner of the dual cell
  float in[3];  ///< from that voxel's centre
  bool base;    ///< all its cells are undug
};

struct Contour {
  std::vector<ContourVertex> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counter-clockwise seen from the air
  /// By triangle: the cell at the lower end of the edge that it surrounds.
  std::vector<int> edges;
};

/// Dual contouring (Ju et al. 2002) with a vertex for each sheet of the surface in a dual cell, so
/// that close sheets do not touch. Signs are those of voxel centres; the models decide the middle
/// of an ambiguous face.
///
/// Guarantees: no edge has more than two triangles; edges with one lie where the requested chunks
/// end. The vertices and triangles around an edge of the grid depend only on the models of the
/// voxels around it. A polygon belongs to the chunk of the lower end of the edge that it surrounds,
/// or to that of the upper end if only that chunk is resident.
/// @param range 0: the polygons of the requested chunks; otherwise all polygons less than `range`
/// voxels from them, resident or not
Contour contour(const CellModels& models, int range);

}  // namespace soilvdb::inline v0
