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

std::unique_ptr<FloatLeaf> surface_leaf(const Soil& soil, const Coord3& origin) {
  float phi_m[kLeafSize];
  surface_distance(soil, origin, phi_m);
  const float band = static_cast<float>(soil.band_m());
  auto leaf = std::make_unique<FloatLeaf>(openvdb::Coord(origin.x(), origin.y(), origin.z()), band);
  for (openvdb::Index n = 0; n < kLeafSize; ++n) {
    leaf->setValueOnly(n, phi_m[n]);
    leaf->setActiveState(n, std::abs(phi_m[n]) < band);
  }
  return leaf;
}

openvdb::FloatGrid::Ptr surface_grid(const Soil& soil) {
  const std::vector<const Chunk*> chunks = soil.chunks();
  std::vector<std::unique_ptr<FloatLeaf>> leaves(chunks.size());
  tbb::parallel_for(std::size_t{0}, chunks.size(),
                    [&](std::size_t i) { leaves[i] = surface_leaf(soil, chunks[i]->origin); });
  openvdb::FloatGrid::Ptr grid = empty_surface_grid(soil);
  for (auto& leaf : leaves) grid->tree().addLeaf(leaf.release());
  return grid;
}

}  // namespace soilvdb
