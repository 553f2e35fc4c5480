// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/mesher.h"

#include <tbb/parallel_for.h>

#include <bit>
#include <set>
#include <unordered_map>

#include "core/lattice/chunk_math.h"
#include "core/surface/surface.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {
namespace {

/// A vertex by its bits.
struct PointHash {
  std::size_t operator()(const Eigen::Vector3f& p) const {
    std::uint64_t h = 0;
    for (int a = 0; a < 3; ++a) h = (h ^ std::bit_cast<std::uint32_t>(p[a])) * 0x9e3779b97f4a7c15u;
    return h ^ (h >> 29);
  }
};

Mesh mesh_block_with(const Ground& ground, const Coord3& block, FitCache* cache) {
  Mesh mesh;
  const std::vector<Coord3> chunks = resident_chunks(ground, block);
  if (chunks.empty()) return mesh;
  const SurfaceBlock surface(ground, chunks, SurfaceBlock::kMesh, cache);
  const Contour& contour = surface.contour();
  mesh.points.reserve(contour.vertices.size());
  const double h = ground.voxel_size_m();
  for (const ContourVertex& v : contour.vertices) {
    const Coord3 cell = surface.first() + v.cell;
    mesh.points.emplace_back(static_cast<float>(h * (cell.x() + double{v.in[0]})),
                             static_cast<float>(h * (cell.y() + double{v.in[1]})),
                             static_cast<float>(h * (cell.z() + double{v.in[2]})));
  }
  mesh.triangles = contour.triangles;
  return mesh;
}

}  // namespace

Mesh mesh_block(const Ground& ground, const Coord3& block) {
  return mesh_block_with(ground, block, nullptr);
}

CachedMesher::CachedMesher(const Ground& ground)
    : ground_(&ground), cache_(std::make_unique<FitCache>()) {}
CachedMesher::~CachedMesher() = default;
CachedMesher::CachedMesher(CachedMesher&&) noexcept = default;

Mesh CachedMesher::block(const Coord3& block) {
  return mesh_block_with(*ground_, block, cache_.get());
}

std::vector<Coord3> blocks_touched(std::span<const Coord3> chunks) {
  // A chunk's samples affect meshes up to one chunk away.
  std::set<Coord3, Before> blocks;
  for (const Coord3& c : chunks) {
    for (int n = 0; n < 27; ++n)
      blocks.insert(floor_to(c + kChunkSide * step_around(n), kBlockSide));
  }
  return {blocks.begin(), blocks.end()};
}

std::vector<Coord3> SurfaceMesh::update(std::span<const Coord3> changed_chunks) {
  const std::vector<Coord3> blocks = blocks_touched(changed_chunks);
  std::vector<Mesh> patches(blocks.size());
  tbb::parallel_for(std::size_t{0}, blocks.size(),
                    [&](std::size_t i) { patches[i] = mesh_block(ground_, blocks[i]); });
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    if (patches[i].triangles.empty()) {
      patches_.erase(blocks[i]);
    } else {
      patches_[blocks[i]] = std::move(patches[i]);
    }
  }
  return blocks;
}

Mesh weld(const std::map<Coord3, Mesh, Before>& patches) {
  Mesh whole;
  std::unordered_map<Eigen::Vector3f, std::uint32_t, PointHash> index;
  for (const auto& [block, patch] : patches) {
    std::vector<std::uint32_t> map;
    for (const Eigen::Vector3f& p : patch.points) {
      const auto [it, fresh] =
          index.try_emplace(p, static_cast<std::uint32_t>(whole.points.size()));
      if (fresh) whole.points.push_back(p);
      map.push_back(it->second);
    }
    for (const auto& t : patch.triangles)
      whole.triangles.push_back({map[t[0]], map[t[1]], map[t[2]]});
  }
  return whole;
}

Mesh mesh_all(const Ground& ground) {
  SurfaceMesh mesh(ground);
  mesh.update(ground.origins());
  return weld(mesh.patches());
}

}  // namespace soilvdb::inline v0
