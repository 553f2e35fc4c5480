// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/ground_grids.h"

#include <algorithm>
#include <cmath>

#include "core/lattice/chunk_math.h"
#include "core/surface/surface.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {

openvdb::FloatGrid::Ptr empty_surface_grid(const Ground& ground) {
  openvdb::initialize();
  auto grid = openvdb::FloatGrid::create(static_cast<float>(ground.band_m()));
  grid->setTransform(openvdb::math::Transform::createLinearTransform(ground.voxel_size_m()));
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setName("surface");
  return grid;
}

std::unique_ptr<FloatLeaf> level_set_leaf(const Coord3& origin, const float* phi_m, float band_m) {
  auto leaf =
      std::make_unique<FloatLeaf>(openvdb::Coord(origin.x(), origin.y(), origin.z()), band_m);
  for (openvdb::Index n = 0; n < kChunkVoxels; ++n) {
    leaf->setValueOnly(n, phi_m[n]);
    leaf->setActiveState(n, std::abs(phi_m[n]) < band_m);
  }
  return leaf;
}

std::vector<Coord3> chunks_with_surface(const Ground& ground) {
  std::vector<Coord3> all;
  for (const Chunk* chunk : ground.chunks()) {
    for (int n = 0; n < 27; ++n) all.push_back(chunk->origin + kChunkSide * step_around(n));
  }
  sort_once(all);
  return all;
}

openvdb::FloatGrid::Ptr surface_grid(const Ground& ground, std::span<const Coord3> chunks) {
  const float band = static_cast<float>(ground.band_m());
  std::vector<std::unique_ptr<FloatLeaf>> leaves(chunks.size());
  surface_distances(ground, chunks, [&](std::size_t i, const float* phi_m) {
    if (ground.find(chunks[i]) == nullptr) {
      float base_m[kChunkVoxels];
      ground.terrain().distance(ground.world_from_index(chunks[i].cast<double>()),
                                ground.voxel_size_m(), ground.band_m(), base_m);
      if (std::equal(base_m, base_m + kChunkVoxels, phi_m)) return;
    }
    leaves[i] = level_set_leaf(chunks[i], phi_m, band);
  });
  openvdb::FloatGrid::Ptr grid = empty_surface_grid(ground);
  for (auto& leaf : leaves) {
    if (leaf) grid->tree().addLeaf(leaf.release());
  }
  return grid;
}

}  // namespace soilvdb::inline v0
