// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Meshes of the resident ground, block by block.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "soilvdb/chunk_range.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Voxels per side of a block, the unit in which ground is meshed.
inline constexpr int kBlockSide = 32;

/// Triangles, or quads as two triangles each. Local coordinates: add Ground::origin() for the
/// world.
struct Mesh {
  std::vector<Eigen::Vector3f> points;                  ///< m, relative to the site's origin
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counter-clockwise seen from the air
};

/// The surface in the resident chunks of one block. Patches of neighbouring blocks share their
/// border vertices bit for bit, so the union of all patches is watertight but for its rim, where
/// the resident ground ends. Safe to call from several threads while nothing writes to the ground.
/// @param block origin in index space, multiples of 32
Mesh mesh_block(const Ground& ground, const Coord3& block);

class FitCache;  // core/cell/fit_cache.h

/// Meshes blocks again and again, the same as mesh_block() does: where a bucket changed a corner of
/// one, in two thirds of the time. For one thread at a time, while nothing writes to the ground,
/// which outlives it.
class CachedMesher {
 public:
  explicit CachedMesher(const Ground& ground);
  ~CachedMesher();
  CachedMesher(CachedMesher&&) noexcept;
  Mesh block(const Coord3& block);

 private:
  const Ground* ground_;
  std::unique_ptr<FitCache> cache_;  // 3 MB
};

/// Origins of the blocks whose patch depends on any of these chunks, sorted.
std::vector<Coord3> blocks_touched(std::span<const Coord3> chunks);

/// The whole surface, kept up to date block by block.
class SurfaceMesh {
 public:
  explicit SurfaceMesh(const Ground& ground) : ground_(ground) {}
  /// Meshes again what these chunks can have changed. @return the blocks meshed.
  std::vector<Coord3> update(std::span<const Coord3> changed_chunks);
  /// Patches by block origin.
  const std::map<Coord3, Mesh, Before>& patches() const { return patches_; }

 private:
  const Ground& ground_;
  std::map<Coord3, Mesh, Before> patches_;
};

/// One mesh of many patches, vertices with equal coordinates made one.
Mesh weld(const std::map<Coord3, Mesh, Before>& patches);

/// All resident ground in one welded mesh.
Mesh mesh_all(const Ground& ground);

}  // namespace soilvdb::inline v0
