// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Level set and mesh of the ground, made from its samples on request.
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

/// The surface in some chunks, from their samples and those one or two chunks around them.
///
/// Invariant: the result at a place depends on the words around it, and not on the block, the
/// thread or the other requested chunks. Pieces thus join bit for bit. Guarantees, for ground of
/// planes that meet (digs of straight edges) with voxels of at most a tenth of the dig: vertices
/// are within 0.15 voxel of the true surface at creases and 0.02 rms elsewhere; the volume is that
/// of the samples to 0.1 %. Caveats: walls and slots thinner than 0.7 voxel are found but
/// misplaced; a surface that bends with a radius below four voxels consists of facets.
class SurfaceBlock {
 public:
  enum Need { kMesh, kDistance };
  /// @param chunks at least one; memory and time are proportional to the cube around them
  /// @param cache of earlier blocks; may be null
  SurfaceBlock(const Ground& ground, std::span<const Coord3> chunks, Need need,
               FitCache* cache = nullptr);

  /// The triangles of the chunks; with kDistance also of the chunks around.
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

/// Signed distance at the 8x8x8 voxel centres of a chunk, from its samples and those two chunks
/// around it: m, negative in soil, clamped to +-Ground::band_m(), to the nearest point of terrain
/// or cut. If that point is on the initial terrain and no sample around has changed, the distance
/// is the terrain's own, to the bit.
/// @param phi_m 512 values. Safe to call from several threads while nothing writes to the ground.
void surface_distance(const Ground& ground, const Coord3& chunk_origin, float* phi_m);

/// The same for many chunks with shared work: calls `out(i, phi_m)` once for each, from several
/// threads.
void surface_distances(const Ground& ground, std::span<const Coord3> chunks,
                       const std::function<void(std::size_t, const float*)>& out);

/// The resident chunks of a block.
std::vector<Coord3> resident_chunks(const Ground& ground, const Coord3& block);

}  // namespace soilvdb::inline v0
