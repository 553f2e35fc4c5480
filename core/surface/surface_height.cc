// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/surface_height.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>
#include <memory>

namespace soilvdb::inline v0 {
namespace {

constexpr int kBlockMask = ~(kBlockSide - 1);

/// Where a vertical line meets a triangle; nothing where it doesn't, or only along an edge-on one.
std::optional<double> height_on(const Vec3& a, const Vec3& b, const Vec3& c, const Vec2& at) {
  const auto side = [&](const Vec3& p, const Vec3& q) {
    return (q.x() - p.x()) * (at.y() - p.y()) - (q.y() - p.y()) * (at.x() - p.x());
  };
  const double wa = side(b, c), wb = side(c, a), wc = side(a, b), sum = wa + wb + wc;
  const bool inside = (wa >= 0 && wb >= 0 && wc >= 0) || (wa <= 0 && wb <= 0 && wc <= 0);
  if (!inside || sum == 0) return std::nullopt;
  return (wa * a.z() + wb * b.z() + wc * c.z()) / sum;
}

}  // namespace

SurfaceHeight::SurfaceHeight(const Soil& soil) : soil_(soil) {
  for (const Chunk* chunk : soil.chunks()) {
    const Coord3& c = chunk->origin;
    std::vector<int>& blocks = blocks_[{c.x() & kBlockMask, c.y() & kBlockMask}];
    const int z = c.z() & kBlockMask;
    if (std::find(blocks.begin(), blocks.end(), z) == blocks.end()) blocks.push_back(z);
  }
}

const SurfaceHeight::Patch& SurfaceHeight::patch(const Coord3& block) {
  const auto [it, fresh] = patches_.try_emplace(block);
  Patch& patch = it->second;
  if (!fresh) return patch;
  patch.mesh = mesh_block(soil_, block);
  const float h = static_cast<float>(soil_.voxel_size_m());
  for (std::uint32_t k = 0; k < patch.mesh.triangles.size(); ++k) {
    const auto& t = patch.mesh.triangles[k];
    Eigen::Vector2f low = patch.mesh.points[t[0]].head<2>(), high = low;
    for (const std::uint32_t v : t) {
      low = low.cwiseMin(patch.mesh.points[v].head<2>());
      high = high.cwiseMax(patch.mesh.points[v].head<2>());
    }
    low = (low / h).array().floor();
    high = (high / h).array().floor();
    for (int x = static_cast<int>(low.x()); x <= static_cast<int>(high.x()); ++x) {
      for (int y = static_cast<int>(low.y()); y <= static_cast<int>(high.y()); ++y) {
        patch.columns[{x, y}].push_back(k);
      }
    }
  }
  return patch;
}

std::optional<double> SurfaceHeight::at(double x, double y) {
  const Vec3 index = soil_.index_from_world({x, y, soil_.origin().z()});
  const std::pair<int, int> column(static_cast<int>(std::floor(index.x())),
                                   static_cast<int>(std::floor(index.y())));
  const Vec2 at = Vec2(x, y) - soil_.origin().head<2>();
  std::optional<double> top;
  // A polygon belongs to the block of its edge's lower end, which may be a voxel beyond.
  const int own_x = column.first & kBlockMask, own_y = column.second & kBlockMask;
  for (const int dx : {0, -1, 1}) {
    for (const int dy : {0, -1, 1}) {
      const int bx = (column.first + dx) & kBlockMask, by = (column.second + dy) & kBlockMask;
      if ((dx != 0 && bx == own_x) || (dy != 0 && by == own_y)) continue;
      const auto blocks = blocks_.find({bx, by});
      if (blocks == blocks_.end()) continue;
      for (const int z : blocks->second) {
        const Patch& p = patch({bx, by, z});
        const auto found = p.columns.find(column);
        if (found == p.columns.end()) continue;
        std::optional<double> here;
        for (const std::uint32_t k : found->second) {
          const auto& t = p.mesh.triangles[k];
          const auto height =
              height_on(p.mesh.points[t[0]].cast<double>(), p.mesh.points[t[1]].cast<double>(),
                        p.mesh.points[t[2]].cast<double>(), at);
          if (height) here = std::max(here.value_or(*height), *height);
        }
        if (here) top = std::max(top.value_or(*here), *here);
      }
    }
  }
  // Ground that isn't resident may be on top of what is: the roof of a hollow.
  const std::optional<double> base = soil_.base().height(x, y);
  const auto resident = [&](double z) {
    const Vec3 p = soil_.index_from_world({x, y, z});
    const Coord3 voxel = (p.array() + 0.5).floor().matrix().cast<int>();
    constexpr int kChunk = ~(kChunkSide - 1);
    return soil_.find({voxel.x() & kChunk, voxel.y() & kChunk, voxel.z() & kChunk}) != nullptr;
  };
  if (!top) return base;
  const double height = *top + soil_.origin().z();
  if (base && *base > height && !resident(*base)) return base;
  return height;
}

std::function<std::optional<double>(double x, double y)> surface_heights(const Soil& soil) {
  using Own = tbb::enumerable_thread_specific<SurfaceHeight>;
  return [own = std::make_shared<Own>([&soil] { return SurfaceHeight(soil); })](
             double x, double y) { return own->local().at(x, y); };
}

std::optional<double> surface_height(const Soil& soil, double x, double y) {
  return SurfaceHeight(soil).at(x, y);
}

}  // namespace soilvdb::inline v0
