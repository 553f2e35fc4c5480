// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/surface_height.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/surface.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {
namespace {

/// The column of voxels whose corners' middles are around a place.
Eigen::Vector2i column_at(const Ground& ground, double x, double y) {
  const Vec3 index = ground.index_from_world({x, y, ground.origin().z()});
  // No chunk is farther away, and an int holds no more.
  const auto column = [](double v) {
    return static_cast<int>(
        std::clamp(std::isnan(v) ? 0 : std::floor(v), -2 * kMaxIndex, 2 * kMaxIndex));
  };
  return {column(index.x()), column(index.y())};
}

/// Columns of one part, which are at the same border of a block or at none, have the same blocks.
Eigen::Vector2i part_of(const Eigen::Vector2i& column) {
  return column.unaryExpr([](int v) {
    const int block = floor_to(v, kBlockSide), in_block = v - block;
    return block + (in_block == 0 ? 0 : in_block == kBlockSide - 1 ? 2 : 1);
  });
}

/// The height at which a vertical line meets a triangle; empty if it misses, or the triangle is
/// vertical.
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

SurfaceHeight::SurfaceHeight(const Ground& ground) : ground_(ground) {
  for (const Chunk* chunk : ground.chunks()) add(chunk->origin);
}

void SurfaceHeight::add(const Coord3& chunk) {
  const Coord3 block = floor_to(chunk, kBlockSide);
  std::vector<int>& blocks = blocks_[{block.x(), block.y(), 0}];
  if (std::find(blocks.begin(), blocks.end(), block.z()) == blocks.end())
    blocks.push_back(block.z());
}

void SurfaceHeight::update(std::span<const Coord3> changed_chunks) {
  // Repeated looks at changing ground mesh blocks that are mostly unchanged.
  if (!mesher_ && !changed_chunks.empty() && !patches_.empty()) mesher_.emplace(ground_);
  for (const Coord3& chunk : changed_chunks) add(chunk);
  for (const Coord3& block : blocks_touched(changed_chunks)) patches_.erase(block);
}

void SurfaceHeight::make(const Coord3& block, Patch& patch, CachedMesher* mesher) const {
  patch.mesh = mesher != nullptr ? mesher->block(block) : mesh_block(ground_, block);
  const auto h = static_cast<float>(ground_.voxel_size_m());
  const std::vector<std::array<std::uint32_t, 3>>& triangles = patch.mesh.triangles;
  std::vector<Eigen::AlignedBox2i> columns(triangles.size());
  Eigen::AlignedBox2i all;
  for (std::size_t k = 0; k < triangles.size(); ++k) {
    for (const std::uint32_t v : triangles[k]) {
      const Eigen::Vector2f at = patch.mesh.points[v].head<2>() / h;
      columns[k].extend(Eigen::Vector2i(at.array().floor().matrix().cast<int>()));
    }
    all.extend(columns[k]);
  }
  if (all.isEmpty()) return;
  patch.first = all.min();
  patch.size = all.sizes() + Eigen::Vector2i::Ones();
  patch.begin.assign(static_cast<std::size_t>(patch.size.prod() + 1), 0);
  const auto each = [&](const auto& f) {
    for (std::uint32_t k = 0; k < triangles.size(); ++k)
      for (int x = columns[k].min().x(); x <= columns[k].max().x(); ++x)
        for (int y = columns[k].min().y(); y <= columns[k].max().y(); ++y)
          f(static_cast<std::size_t>((x - patch.first.x()) * patch.size.y() + y - patch.first.y()),
            k);
  };
  each([&](std::size_t column, std::uint32_t) { ++patch.begin[column + 1]; });
  std::partial_sum(patch.begin.begin(), patch.begin.end(), patch.begin.begin());
  patch.over.resize(patch.begin.back());
  std::vector<std::uint32_t> next(patch.begin.begin(), patch.begin.end() - 1);
  each([&](std::size_t column, std::uint32_t k) { patch.over[next[column]++] = k; });
}

/// Calls f(block) for all blocks whose triangles may be over a place: a polygon belongs to the
/// block of its edge's lower end, which may be a voxel beyond.
template <typename F>
void SurfaceHeight::each_block(double x, double y, const F& f) const {
  const Eigen::Vector2i column = column_at(ground_, x, y);
  const Eigen::Vector2i low = floor_to(column - Eigen::Vector2i::Ones(), kBlockSide);
  const Eigen::Vector2i high = floor_to(column + Eigen::Vector2i::Ones(), kBlockSide);
  for (int bx = low.x(); bx <= high.x(); bx += kBlockSide) {
    for (int by = low.y(); by <= high.y(); by += kBlockSide) {
      const auto blocks = blocks_.find({bx, by, 0});
      if (blocks == blocks_.end()) continue;
      for (const int z : blocks->second) f(Coord3(bx, by, z));
    }
  }
}

/// Where all patches are there.
std::optional<double> SurfaceHeight::look(double x, double y) const {
  const Eigen::Vector2i column = column_at(ground_, x, y);
  const Vec2 at = Vec2(x, y) - ground_.origin().head<2>();
  std::optional<double> top;
  each_block(x, y, [&](const Coord3& block) {
    const Patch& p = patches_.find(block)->second;
    const Eigen::Vector2i in_patch = column - p.first;
    if ((in_patch.array() < 0).any() || (in_patch.array() >= p.size.array()).any()) return;
    const auto n = static_cast<std::size_t>(in_patch.x() * p.size.y() + in_patch.y());
    for (std::uint32_t i = p.begin[n]; i < p.begin[n + 1]; ++i) {
      const auto& t = p.mesh.triangles[p.over[i]];
      const auto height =
          height_on(p.mesh.points[t[0]].cast<double>(), p.mesh.points[t[1]].cast<double>(),
                    p.mesh.points[t[2]].cast<double>(), at);
      if (height) top = std::max(top.value_or(*height), *height);
    }
  });
  // Ground that is not resident may be above resident chunks: the roof of a hollow.
  const std::optional<double> base = ground_.terrain().height(x, y);
  const auto resident = [&](double z) {
    return ground_.find(chunk_of(ground_.index_from_world({x, y, z}))) != nullptr;
  };
  if (!top) return base;
  const double height = *top + ground_.origin().z();
  if (base && *base > height && !resident(*base)) return base;
  return height;
}

std::optional<double> SurfaceHeight::at(double x, double y) {
  each_block(x, y, [&](const Coord3& block) {
    const auto [patch, fresh] = patches_.try_emplace(block);
    if (fresh) make(block, patch->second, mesher_ ? &*mesher_ : nullptr);
  });
  return look(x, y);
}

void SurfaceHeight::at(std::span<const Vec2> xy_m, std::span<double> heights_m) {
  const std::size_t count = std::min(xy_m.size(), heights_m.size());
  std::vector<std::pair<Coord3, Patch*>> missing;
  for (std::size_t from = 0, to = 0; from < count; from = to) {
    if (patches_.size() > kMaxHeightPatches) patches_.clear();
    missing.clear();
    Eigen::Vector2i known(-1, -1);  // part whose blocks are there; none is that one
    for (; to < count && missing.size() < kMaxHeightPatches; ++to) {
      const Eigen::Vector2i part = part_of(column_at(ground_, xy_m[to].x(), xy_m[to].y()));
      if (part == known) continue;
      known = part;
      each_block(xy_m[to].x(), xy_m[to].y(), [&](const Coord3& block) {
        const auto [patch, fresh] = patches_.try_emplace(block);
        if (fresh) missing.emplace_back(block, &patch->second);
      });
    }
    if (mesher_ && missing.size() <= kMemoPatches) {
      for (const auto& [block, patch] : missing) make(block, *patch, &*mesher_);
    } else {
      tbb::parallel_for(std::size_t{0}, missing.size(), [&](std::size_t i) {
        make(missing[i].first, *missing[i].second, nullptr);
      });
    }
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(from, to, kHeightsPerThread),
        [&](const tbb::blocked_range<std::size_t>& range) {
          for (std::size_t i = range.begin(); i < range.end(); ++i)
            heights_m[i] =
                look(xy_m[i].x(), xy_m[i].y()).value_or(std::numeric_limits<double>::quiet_NaN());
        });
  }
}

std::function<std::optional<double>(double x, double y)> surface_heights(const Ground& ground) {
  using Own = tbb::enumerable_thread_specific<SurfaceHeight>;
  return [own = std::make_shared<Own>([&ground] { return SurfaceHeight(ground); })](
             double x, double y) { return own->local().at(x, y); };
}

std::optional<double> surface_height(const Ground& ground, double x, double y) {
  return SurfaceHeight(ground).at(x, y);
}

}  // namespace soilvdb::inline v0
