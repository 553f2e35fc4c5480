// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/soil_grids.h"

#include <tbb/parallel_for.h>

#include <cmath>

#include "core/surface.h"

namespace soilvdb {

openvdb::FloatGrid::Ptr empty_surface_grid(const Soil& soil) {
  openvdb::initialize();
  auto grid = openvdb::FloatGrid::create(static_cast<float>(soil.band_m()));
  grid->setTransform(openvdb::math::Transform::createLinearTransform(soil.voxel_size_m()));
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setName("surface");
  return grid;
}

std::unique_ptr<FloatLeaf> level_set_leaf(const Coord3& origin, const float* phi_m, float band_m) {
  auto leaf =
      std::make_unique<FloatLeaf>(openvdb::Coord(origin.x(), origin.y(), origin.z()), band_m);
  for (openvdb::Index n = 0; n < kLeafSize; ++n) {
    leaf->setValueOnly(n, phi_m[n]);
    leaf->setActiveState(n, std::abs(phi_m[n]) < band_m);
  }
  return leaf;
}

openvdb::FloatGrid::Ptr surface_grid(const Soil& soil) {
  std::vector<Coord3> origins;
  for (const Chunk* chunk : soil.chunks()) origins.push_back(chunk->origin);
  std::vector<std::unique_ptr<FloatLeaf>> leaves(origins.size());
  surface_distances(soil, origins, [&](std::size_t i, const float* phi_m) {
    leaves[i] = level_set_leaf(origins[i], phi_m, static_cast<float>(soil.band_m()));
  });
  openvdb::FloatGrid::Ptr grid = empty_surface_grid(soil);
  for (auto& leaf : leaves) grid->tree().addLeaf(leaf.release());
  return grid;
}

}  // namespace soilvdb
