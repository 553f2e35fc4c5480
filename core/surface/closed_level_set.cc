// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <openvdb/tools/Prune.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <stdexcept>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/surface.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/ground_grids.h"

namespace soilvdb::inline v0 {
namespace {

/// @throw std::invalid_argument if there are too many
std::vector<Coord3> chunks_of(const Eigen::AlignedBox3d& cells) {
  if ((cells.sizes() / kChunkSide).prod() > kMaxLevelSetChunks)
    throw std::invalid_argument("the region is too large at this voxel size; choose a smaller one");
  std::vector<Coord3> origins;
  for_each_chunk(cells, [&](const Coord3& origin) { origins.push_back(origin); });
  return origins;
}

/// Signed distance to a box, negative inside.
double box_distance(const Eigen::AlignedBox3d& box, const Vec3& p) {
  const Vec3 beyond = (box.min() - p).cwiseMax(p - box.max());
  return beyond.maxCoeff() <= 0 ? beyond.maxCoeff() : beyond.cwiseMax(0).norm();
}

}  // namespace

openvdb::FloatGrid::Ptr closed_level_set(const Ground& ground, const Eigen::AlignedBox3d& box) {
  const float band = static_cast<float>(ground.band_m());
  openvdb::FloatGrid::Ptr grid = empty_surface_grid(ground);

  const Vec3 margin = Vec3::Constant(ground.band_m() / ground.voxel_size_m());
  const Eigen::AlignedBox3d cells(ground.index_from_world(box.min()) - margin,
                                  ground.index_from_world(box.max()) + margin);
  const std::vector<Coord3> origins = chunks_of(cells);

  // Per chunk: a leaf, or a tile that is all soil, or nothing.
  std::vector<std::unique_ptr<FloatLeaf>> leaves(origins.size());
  enum Kind : std::uint8_t { kEmpty, kSolid, kMixed };
  std::vector<Kind> kinds(origins.size(), kEmpty);
  tbb::parallel_for(std::size_t{0}, origins.size(), [&](std::size_t i) {
    const Coord3& origin = origins[i];
    if (ground.find(origin) == nullptr) {
      // The band reaches beyond the chunk's own cells.
      const Vec3 low = ground.world_from_index(origin.cast<double>()) - Vec3::Constant(band);
      const Vec3 high =
          ground.world_from_index((origin + Coord3::Constant(kChunkSide)).cast<double>()) +
          Vec3::Constant(band);
      const Content content = ground.terrain().classify({low, high});
      if (content == Content::kAir) return;
      const bool interior = (low.array() - band >= box.min().array()).all() &&
                            (high.array() + band <= box.max().array()).all();
      if (content == Content::kSoil && interior) {
        kinds[i] = kSolid;
        return;
      }
    }
    kinds[i] = kMixed;
  });
  std::vector<std::size_t> mixed;
  std::vector<Coord3> mixed_origins;
  for (std::size_t i = 0; i < origins.size(); ++i) {
    if (kinds[i] != kMixed) continue;
    mixed.push_back(i);
    mixed_origins.push_back(origins[i]);
  }
  surface_distances(ground, mixed_origins, [&](std::size_t k, const float* phi_m) {
    const Coord3& origin = mixed_origins[k];
    std::array<float, kChunkVoxels> phi;
    bool air = true;
    for (int n = 0; n < kChunkVoxels; ++n) {
      const Vec3 p = ground.world_from_index((origin + numbered_voxel(n)).cast<double>());
      phi[n] = std::max(phi_m[n], static_cast<float>(std::min(box_distance(box, p), double{band})));
      air &= phi[n] >= band;
    }
    if (!air) leaves[mixed[k]] = level_set_leaf(origin, phi.data(), band);
  });
  auto& tree = grid->tree();
  for (std::size_t i = 0; i < origins.size(); ++i) {
    if (leaves[i]) {
      tree.addLeaf(leaves[i].release());
    } else if (kinds[i] == kSolid) {
      tree.addTile(1, openvdb::Coord(origins[i].x(), origins[i].y(), origins[i].z()), -band, false);
    }
  }
  openvdb::tools::pruneLevelSet(tree);
  return grid;
}

openvdb::FloatGrid::Ptr occupancy_grid(const Ground& ground, const Eigen::AlignedBox3d& box) {
  openvdb::initialize();
  const Eigen::AlignedBox3d cells(ground.index_from_world(box.min()),
                                  ground.index_from_world(box.max()));
  const std::vector<Coord3> origins = chunks_of(cells);
  const auto within = [&](const Coord3& voxel) { return cells.contains(voxel.cast<double>()); };
  std::vector<std::unique_ptr<FloatLeaf>> leaves(origins.size());
  std::vector<std::uint8_t> solid(origins.size());
  tbb::parallel_for(std::size_t{0}, origins.size(), [&](std::size_t i) {
    const Coord3& origin = origins[i];
    SampleWords words;
    ground.read_samples(origin, words);
    solid[i] = within(origin) && within(origin + Coord3::Constant(kChunkSide - 1)) &&
               std::all_of(words.begin(), words.end(), [](auto word) { return word == kAllSoil; });
    if (solid[i]) return;
    auto leaf = std::make_unique<FloatLeaf>(openvdb::Coord(origin.x(), origin.y(), origin.z()));
    for (int n = 0; n < kChunkVoxels; ++n) {
      const std::uint64_t word = words[static_cast<std::size_t>(n)];
      if (word != 0 && within(origin + numbered_voxel(n)))
        leaf->setValueOn(static_cast<openvdb::Index>(n),
                         static_cast<float>(std::popcount(word)) / 64);
    }
    if (!leaf->isEmpty()) leaves[i] = std::move(leaf);
  });
  auto grid = openvdb::FloatGrid::create();
  grid->setTransform(openvdb::math::Transform::createLinearTransform(ground.voxel_size_m()));
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  grid->setName("occupancy");
  for (std::size_t i = 0; i < origins.size(); ++i) {
    const Coord3& c = origins[i];
    if (leaves[i]) grid->tree().addLeaf(leaves[i].release());
    if (solid[i]) grid->tree().addTile(1, openvdb::Coord(c.x(), c.y(), c.z()), 1, true);
  }
  openvdb::tools::prune(grid->tree());
  return grid;
}

}  // namespace soilvdb::inline v0
