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

/// Voxels per side of a block, the unit of meshing.
inline constexpr int kBlockSide = 32;

/// Triangles; a quad is two triangles. Add Ground::origin() for world coordinates.
struct Mesh {
  std::vector<Eigen::Vector3f> points;                  ///< m, relative to Ground::origin()
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counter-clockwise seen from the air
};

/// The surface in the resident chunks of one block. Patches of adjacent blocks have bitwise equal
/// border vertices: their union is watertight except at the rim of the resident ground. Threads may
/// call it concurrently while the ground does not change.
/// @param block origin in index space, multiples of 32
Mesh mesh_block(const Ground& ground, const Coord3& block);

class FitCache;  // core/cell/fit_cache.h

/// Meshes blocks repeatedly with the result of mesh_block(). After a change in a corner of a block
/// it takes two thirds of the time. Only one thread at a time may use it, while the ground does not
/// change. The ground must outlive it.
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

/// Sorted origins of the blocks whose patches depend on these chunks.
std::vector<Coord3> blocks_touched(std::span<const Coord3> chunks);

/// The whole surface, updated block by block. The ground must outlive it.
class SurfaceMesh {
 public:
  explicit SurfaceMesh(const Ground& ground) : ground_(ground) {}
  /// Remeshes the blocks that depend on these chunks. @return origins of these blocks
  std::vector<Coord3> update(std::span<const Coord3> changed_chunks);
  /// Patches by block origin.
  const std::map<Coord3, Mesh, Before>& patches() const { return patches_; }

 private:
  const Ground& ground_;
  std::map<Coord3, Mesh, Before> patches_;
};

/// Joins patches into one mesh and merges vertices with equal coordinates.
Mesh weld(const std::map<Coord3, Mesh, Before>& patches);

/// The resident ground as one welded mesh.
Mesh mesh_all(const Ground& ground);

}  // namespace soilvdb::inline v0
