// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/draw/loose_soil.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <vector>

#include "core/lattice/chunk_math.h"
#include "core/lattice/splitmix64.h"
#include "soilvdb/io/picture.h"

namespace soilvdb::inline v0::io {
namespace {

/// Pseudo-random number number `which` of a lattice point, uniform in [0, 1).
double noise(const Coord3& c, int which) {
  const auto key = [](int v) { return static_cast<std::uint64_t>(static_cast<std::uint32_t>(v)); };
  const std::uint64_t hash =
      splitmix64(splitmix64(key(c.x()) << 32 | key(c.y())) ^ (key(c.z()) << 8 | key(which)));
  return static_cast<double>(hash >> 11) * 0x1p-53;
}

/// Samples of a cell.
struct Cell {
  int soil = 0, loose = 0;
};

Cell cell_at(const Ground& ground, const Coord3& voxel) {
  const Coord3 origin = floor_to(voxel, kChunkSide);
  const Chunk* chunk = ground.find(origin);
  if (chunk == nullptr) return {ground.classify(origin) == Content::kAir ? 0 : 64, 0};
  const auto count = [n = cell_number(voxel)](const Chunk& c) {
    return Cell{std::popcount(c.samples.word(n)), std::popcount(c.loose.word(n))};
  };
  return chunk->swap_record == 0 ? count(*chunk) : count(ground.copy(*chunk));
}

}  // namespace

double looseness(const Ground& ground, const Vec3& point) {
  const Vec3 at = ground.index_from_world(point);
  const Coord3 low = at.array().floor().matrix().cast<int>();
  const Vec3 f = at - low.cast<double>();
  double all = 0, loose = 0;
  for (int n = 0; n < 8; ++n) {
    const Coord3 corner(n & 1, n >> 1 & 1, n >> 2 & 1);
    double weight = 1;
    for (int a = 0; a < 3; ++a) weight *= corner[a] == 1 ? f[a] : 1 - f[a];
    const Cell cell = cell_at(ground, low + corner);
    all += weight * cell.soil;
    loose += weight * cell.loose;
  }
  return all > 0 ? loose / all : 0;
}

bool has_loose(const Ground& ground) {
  const std::vector<const Chunk*> chunks = ground.chunks();
  return std::any_of(chunks.begin(), chunks.end(),
                     [](const Chunk* chunk) { return chunk->loose_count > 0; });
}

double clod_m(double picture_m, double voxel_size_m) {
  return std::max(voxel_size_m, picture_m / 190);
}

Rgb as_loose(const Rgb& color, const Vec3& point, double clod_m, double loose) {
  const double share = std::clamp(4 * (loose - 0.3) + 0.5, 0.0, 1.0);
  if (share == 0) return color;
  const Vec3 at = point / clod_m;
  const Coord3 here = at.array().floor().matrix().cast<int>();
  double nearest = std::numeric_limits<double>::infinity(), second = nearest, tone = 0, up = 0;
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const Coord3 c = here + Coord3(dx, dy, dz);
        const Vec3 middle = c.cast<double>() + Vec3(noise(c, 0), noise(c, 1), noise(c, 2));
        const double d = (at - middle).norm();
        if (d < nearest) {
          second = nearest;
          nearest = d;
          tone = noise(c, 3);
          up = (at - middle).dot(Vec3(-0.5, 0.5, 0.7));
        } else {
          second = std::min(second, d);
        }
      }
    }
  }
  const double gap = std::clamp((second - nearest) / 0.22, 0.0, 1.0);
  const double light = 0.87 + 0.16 * tone + 0.13 * up - 0.22 * (1 - gap);
  const Rgb clod = light < 1 ? scaled(color, light) : mix(color, {1, 1, 1}, light - 1);
  return mix(color, clod, share);
}

}  // namespace soilvdb::inline v0::io
