// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Level set and mesh of the ground, made from its samples when somebody looks.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "core/cell/cell_models.h"
#include "core/surface/dual_contour.h"
#include "core/surface/surface_distance.h"
#include "soilvdb/ground.h"
#include "soilvdb/mesher.h"

namespace soilvdb::inline v0 {

/// The surface in some chunks: what their samples, and those of a chunk or two around them, show.
///
/// Invariant: what comes out for a place depends on the words around it and not on the block, the
/// thread or the other chunks asked for, so that pieces join bit for bit.
/// Guarantees, for ground of planes that meet (digs of straight edges) at voxels a tenth of what is
/// dug or smaller: vertices within 0.15 voxel of the true surface at creases and 0.02 rms
/// elsewhere; the volume is that of the samples to 0.1 %. Caveats: walls and slots thinner than 0.7
/// voxel are found but misplaced; where the surface bends with a radius below four voxels it is
/// made of facets.
class SurfaceBlock {
 public:
  enum Need { kMesh, kDistance };
  /// @param chunks at least one; memory and time go with the cube around them
  /// @param cache of blocks before; may be null
  SurfaceBlock(const Ground& ground, std::span<const Coord3> chunks, Need need,
               FitCache* cache = nullptr);

  /// The triangles of the chunks; with kDistance also of those around.
  const Contour& contour() const { return contour_; }
  const Coord3& first() const { return grid_.first(); }

  /// phi at the 8x8x8 voxel centres of one of the chunks, made with kDistance.
  void distance(const Coord3& chunk, float* phi_m) const { distance_->chunk(chunk, phi_m); }

 private:
  CellGrid grid_;
  CellModels models_;
  Contour contour_;
  std::optional<ContourDistance> distance_;
};

/// Signed distance at the 8x8x8 voxel centres of a chunk, made from its samples and those of two
/// chunks around: m, negative in soil, clamped to +-Ground::band_m(); to the nearest point of the
/// surface, base or cut. Where that is of the base surface and no sample around was changed it is
/// the base surface's own distance, to the bit.
/// @param phi_m 512 values. Safe to call from several threads while nothing writes to the ground.
void surface_distance(const Ground& ground, const Coord3& chunk_origin, float* phi_m);

/// The same for many chunks, which shares work: `out(i, phi_m)` is called once for each, from
/// several threads.
void surface_distances(const Ground& ground, std::span<const Coord3> chunks,
                       const std::function<void(std::size_t, const float*)>& out);

/// The resident chunks of a block.
std::vector<Coord3> resident_chunks(const Ground& ground, const Coord3& block);

}  // namespace soilvdb::inline v0
