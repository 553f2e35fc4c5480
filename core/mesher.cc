// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/mesher.h"

#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <set>
#include <unordered_map>

#include "core/chunk_range.h"
#include "core/soil_grids.h"

namespace soilvdb {
namespace {

using openvdb::Coord;

constexpr int kChunksPerBlock = kBlockSide / kLeafSide;

Coord coord(const Coord3& c) { return {c.x(), c.y(), c.z()}; }

Coord3 floor_to(const Coord3& c, int side) {
  return {c.x() & ~(side - 1), c.y() & ~(side - 1), c.z() & ~(side - 1)};
}

/// The resident chunks of a block, and those beside it whose surface its quads may be of.
std::vector<Coord3> resident(const Soil& soil, const Coord3& block) {
  constexpr int kSide = kChunksPerBlock + 1;
  std::vector<Coord3> all;
  for (int n = 0; n < kSide * kSide * kSide; ++n) {
    const Coord3 origin =
        block + kLeafSide * Coord3(n / (kSide * kSide), n / kSide % kSide, n % kSide);
    if (soil.find(origin) != nullptr) all.push_back(origin);
  }
  return all;
}

/// A level set of these chunks and all that touch them, so that quads on their faces are whole.
openvdb::FloatGrid::Ptr with_halo(const Soil& soil, const std::vector<Coord3>& chunks) {
  const float band = static_cast<float>(soil.band_m());
  openvdb::FloatGrid::Ptr grid = empty_surface_grid(soil);
  grid->setTransform(openvdb::math::Transform::createLinearTransform());
  std::set<Coord3, SurfaceMesh::Less> all;
  for (const Coord3& c : chunks) {
    for (int n = 0; n < 27; ++n)
      all.insert(c + kLeafSide * Coord3(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1));
  }
  for (const Coord3& c : all) {
    std::unique_ptr<FloatLeaf> leaf = surface_leaf(soil, c);
    if (!leaf->getValueMask().isOff()) {
      grid->tree().addLeaf(leaf.release());
    } else if (leaf->getValue(0) < 0) {
      grid->tree().addTile(1, coord(c), -band, false);
    }
  }
  return grid;
}

/// A vertex by its bits.
struct PointHash {
  std::size_t operator()(const Eigen::Vector3f& p) const {
    std::uint64_t h = 0;
    for (int a = 0; a < 3; ++a) h = (h ^ std::bit_cast<std::uint32_t>(p[a])) * 0x9e3779b97f4a7c15u;
    return h ^ (h >> 29);
  }
};

}  // namespace

Mesh mesh_block(const Soil& soil, const Coord3& block) {
  Mesh mesh;
  const std::vector<Coord3> chunks = resident(soil, block);
  if (chunks.empty()) return mesh;
  // In index space: vertices then depend on distances alone and not on the block.
  std::vector<openvdb::Vec3s> points;
  std::vector<openvdb::Vec3I> triangles;
  std::vector<openvdb::Vec4I> quads;
  openvdb::tools::volumeToMesh(*with_halo(soil, chunks), points, triangles, quads, 0.0, 0.0);

  const float h = static_cast<float>(soil.voxel_size_m());
  std::vector<std::uint32_t> index(points.size(), ~0u);
  const auto vertex = [&](std::uint32_t i) {
    if (index[i] == ~0u) {
      index[i] = static_cast<std::uint32_t>(mesh.points.size());
      mesh.points.emplace_back(points[i].x() * h, points[i].y() * h, points[i].z() * h);
    }
    return index[i];
  };
  for (const openvdb::Vec4I& q : quads) {
    // The quad's four vertices lie in the cells around one edge of the grid; its chunk owns it.
    openvdb::Vec3s low = points[q[0]];
    for (int k = 1; k < 4; ++k) low = openvdb::math::minComponent(low, points[q[k]]);
    const Coord3 owner(static_cast<int>(std::floor(low.x())), static_cast<int>(std::floor(low.y())),
                       static_cast<int>(std::floor(low.z())));
    // It is of the dug ground where a voxel beside it is: a wall may lie on the face of a chunk.
    const auto dug = [&](const Coord3& voxel) {
      return soil.find(floor_to(voxel, kLeafSide)) != nullptr;
    };
    if (floor_to(owner, kBlockSide) != block || !(dug(owner) || dug(owner + Coord3::Ones()))) {
      continue;
    }
    const std::uint32_t a = vertex(q[0]), b = vertex(q[1]), c = vertex(q[2]), d = vertex(q[3]);
    // OpenVDB's quads turn clockwise seen from outside. The shorter diagonal, to follow the ground.
    if ((mesh.points[a] - mesh.points[c]).squaredNorm() <=
        (mesh.points[b] - mesh.points[d]).squaredNorm()) {
      mesh.triangles.push_back({a, c, b});
      mesh.triangles.push_back({a, d, c});
    } else {
      mesh.triangles.push_back({a, d, b});
      mesh.triangles.push_back({b, d, c});
    }
  }
  return mesh;
}

std::vector<Coord3> blocks_touched(std::span<const Coord3> chunks) {
  // A chunk's values reach one cell below its own block.
  std::set<Coord3, SurfaceMesh::Less> blocks;
  for (const Coord3& c : chunks) {
    for (int n = 0; n < 27; ++n) {
      blocks.insert(
          floor_to(c + kLeafSide * Coord3(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1), kBlockSide));
    }
  }
  return {blocks.begin(), blocks.end()};
}

std::vector<Coord3> SurfaceMesh::update(std::span<const Coord3> changed_chunks) {
  const std::vector<Coord3> blocks = blocks_touched(changed_chunks);
  std::vector<Mesh> patches(blocks.size());
  tbb::parallel_for(std::size_t{0}, blocks.size(),
                    [&](std::size_t i) { patches[i] = mesh_block(soil_, blocks[i]); });
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    if (patches[i].triangles.empty()) {
      patches_.erase(blocks[i]);
    } else {
      patches_[blocks[i]] = std::move(patches[i]);
    }
  }
  return blocks;
}

Mesh weld(const std::map<Coord3, Mesh, SurfaceMesh::Less>& patches) {
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

Mesh mesh_all(const Soil& soil) {
  SurfaceMesh mesh(soil);
  std::vector<Coord3> origins;
  for (const Chunk* chunk : soil.chunks()) origins.push_back(chunk->origin);
  mesh.update(origins);
  return weld(mesh.patches());
}

}  // namespace soilvdb
