// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/app/clip.h"

#include <fmt/format.h>
#include <openvdb/io/Stream.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "io/file/atomic_file.h"
#include "io/snapshot/snapshot_format.h"
#include "soilvdb/ground_grids.h"
#include "soilvdb/io/level_set_file.h"
#include "soilvdb/io/raster.h"

namespace soilvdb::tools {
namespace {

/// The mesh without unused points.
Mesh compacted(const Mesh& mesh) {
  constexpr auto kUnused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> place(mesh.points.size(), kUnused);
  Mesh result;
  for (auto triangle : mesh.triangles) {
    for (std::uint32_t& vertex : triangle) {
      if (place[vertex] == kUnused) {
        place[vertex] = static_cast<std::uint32_t>(result.points.size());
        result.points.push_back(mesh.points[vertex]);
      }
      vertex = place[vertex];
    }
    result.triangles.push_back(triangle);
  }
  return result;
}

[[noreturn]] void refuse_without_soil(const io::Site& site) {
  throw std::invalid_argument(fmt::format(
      "it is too small for voxels of {:g} m, or there is no soil", site.ground->voxel_size_m()));
}

std::uint64_t write_grid(const std::filesystem::path& file, const io::Site& site,
                         const openvdb::FloatGrid::Ptr& grid) {
  const Vec3& origin = site.ground->origin();
  grid->insertMeta(io::kOriginKey, openvdb::Vec3DMetadata({origin.x(), origin.y(), origin.z()}));
  grid->insertMeta(io::kCrsKey, openvdb::StringMetadata(site.crs_wkt));
  std::ostringstream bytes;
  openvdb::io::Stream(bytes).write(openvdb::GridCPtrVec{grid});
  std::string text = std::move(bytes).str();
  io::put_uuid(text, io::kExportMark);
  io::write_atomically(file, text);
  return grid->activeVoxelCount();
}

}  // namespace

Mesh mesh_region(const Ground& ground, const Eigen::AlignedBox2d& box) {
  // A block's vertices lie within a voxel of its cells.
  const Vec2 low = (box.min() - ground.origin().head<2>()) / ground.voxel_size_m();
  const Vec2 high = (box.max() - ground.origin().head<2>()) / ground.voxel_size_m();
  std::map<Coord3, Mesh, Before> patches;
  for (const Coord3& block : blocks_touched(ground.origins())) {
    bool meets = true;
    for (int axis = 0; axis < 2; ++axis)
      meets &= block[axis] + kBlockSide + 1 >= low[axis] && block[axis] - 1 <= high[axis];
    if (meets) patches.emplace(block, mesh_block(ground, block));
  }
  Mesh mesh = weld(patches);
  const Vec2 local_min = box.min() - ground.origin().head<2>();
  const Vec2 local_max = box.max() - ground.origin().head<2>();
  std::erase_if(mesh.triangles, [&](const std::array<std::uint32_t, 3>& t) {
    const Vec2 centre =
        (mesh.points[t[0]] + mesh.points[t[1]] + mesh.points[t[2]]).head<2>().cast<double>() / 3;
    return (centre.array() < local_min.array()).any() ||
           (centre.array() >= local_max.array()).any();
  });
  return compacted(mesh);
}

Eigen::AlignedBox3d ground_box(const Ground& ground, const Eigen::AlignedBox2d& plan) {
  constexpr double kMargin_voxels = 10;
  constexpr double kMostCells = 1000;  // across
  const double h = ground.voxel_size_m();
  double low = std::numeric_limits<double>::infinity(), high = -low;
  const io::SurfaceRaster heights =
      io::rasterise(ground, plan, std::max(h, plan.sizes().maxCoeff() / kMostCells));
  for (std::size_t i = 0; i < heights.surface.size(); ++i) {
    const double z = heights.surface[i], base = z - heights.change[i];
    if (std::isnan(z)) continue;
    low = std::min({low, z, base});
    high = std::max({high, z, base});
  }
  for (const Chunk* chunk : ground.chunks()) {
    const Vec3 first = ground.world_from_index(chunk->origin.cast<double>());
    const Vec3 last = first + Vec3::Constant(h * (kChunkSide - 1));
    if (!plan.intersects(Eigen::AlignedBox2d(first.head<2>(), last.head<2>()))) continue;
    low = std::min(low, first.z());
    high = std::max(high, last.z());
  }
  if (!(low <= high)) throw std::invalid_argument("there is no ground");
  const double margin = kMargin_voxels * h;
  return {Vec3(plan.min().x(), plan.min().y(), low - margin),
          Vec3(plan.max().x(), plan.max().y(), high + margin)};
}

std::uint64_t write_level_set(const std::filesystem::path& file, const io::Site& site,
                              const Eigen::AlignedBox3d& box) {
  const openvdb::FloatGrid::Ptr grid = closed_level_set(*site.ground, box);
  bool soil = false;
  for (auto leaf = grid->tree().cbeginLeaf(); leaf && !soil; ++leaf)
    for (auto value = leaf->cbeginValueAll(); value && !soil; ++value) soil = *value < 0;
  if (!soil) refuse_without_soil(site);
  grid->setName("surface");
  return write_grid(file, site, grid);
}

std::uint64_t write_occupancy(const std::filesystem::path& file, const io::Site& site,
                              const Eigen::AlignedBox3d& box) {
  const openvdb::FloatGrid::Ptr grid = occupancy_grid(*site.ground, box);
  if (grid->empty()) refuse_without_soil(site);
  return write_grid(file, site, grid);
}

}  // namespace soilvdb::tools
