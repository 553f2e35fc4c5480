// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Level set and mesh of the ground, made from its samples when somebody looks.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "core/cell_models.h"
#include "core/dual_contour.h"
#include "core/soil.h"

namespace soilvdb {

/// Voxels per side of a block, the unit in which ground is meshed.
inline constexpr int kBlockSide = 32;

/// The surface in some chunks of one block: what its samples, and those of a chunk or two around
/// them, show. What comes out for a place depends on the words around it and not on the block, the
/// thread or the other chunks asked for, so that pieces join bit for bit.
class SurfaceBlock {
 public:
  enum Need { kMesh, kDistance };
  /// @param block origin, multiples of 32 @param chunks of the block
  SurfaceBlock(const Soil& soil, const Coord3& block, std::span<const Coord3> chunks, Need need);

  /// The triangles of the chunks; with kDistance also of those around.
  const Contour& contour() const { return contour_; }
  const Coord3& first() const { return grid_.first(); }

  /// phi of one of the chunks, made with kDistance.
  void distance(const Coord3& chunk, float* phi_m) const;

 private:
  const Soil& soil_;
  CellGrid grid_;
  CellModels models_;
  Contour contour_;
};

/// Signed distance at the 8x8x8 voxel centres of a chunk, made from its samples and those of two
/// chunks around: m, negative in soil, clamped to +-Soil::band_m(); to the nearest point of the
/// surface, base or cut. Where no sample within four voxels was changed it is the base surface's own
/// distance, to the bit.
/// @param phi_m 512 values. Safe to call from several threads while nothing writes to the soil.
void surface_distance(const Soil& soil, const Coord3& chunk_origin, float* phi_m);

/// The resident chunks of a block.
std::vector<Coord3> resident_chunks(const Soil& soil, const Coord3& block);

}  // namespace soilvdb
