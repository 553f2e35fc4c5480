// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/column_gains.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <map>
#include <vector>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::inline v0 {
namespace {

using Box = GainGrid::Box;
using Gains = std::map<Box, Gain>;

/// A cell that changed whole, by volume.
void share_by_volume(const GainGrid& grid, const Vec3& middle, double h, double m3, Gains& gains) {
  const Vec3 half = Vec3::Constant(h / 2 - kBoxInset * grid.side_m.x());
  const Box low = grid.at(middle - half), high = grid.at(middle + half);
  const auto part = [&](int box, std::size_t axis) {
    if (low[axis] == high[axis]) return 1.0;
    const auto a = static_cast<Eigen::Index>(axis);
    const double from = grid.origin[a] + (box - 0.5) * grid.side_m[a];
    const double first = std::max(from, middle[a] - h / 2);
    return (std::min(from + grid.side_m[a], middle[a] + h / 2) - first) / h;
  };
  for (int x = low[0]; x <= high[0]; ++x)
    for (int y = low[1]; y <= high[1]; ++y)
      for (int z = low[2]; z <= high[2]; ++z)
        gains[{x, y, z}].m3 += part(x, 0) * part(y, 1) * part(z, 2) * m3;
}

Gains gains_of(const Soil& soil, const Coord3& origin, const SampleWords& before,
               const SampleWords& after, const GainGrid& grid) {
  Gains gains;
  const double h = soil.voxel_size_m(), error_m3 = kWorstCountError * h * h * h;
  for (int n = 0; n < kChunkVoxels; ++n) {
    const std::uint64_t a = before[static_cast<std::size_t>(n)];
    const std::uint64_t b = after[static_cast<std::size_t>(n)];
    if (a == b) continue;
    const Coord3 voxel = origin + numbered_voxel(n);
    const Vec3 middle = soil.world_from_index(voxel.cast<double>());
    if ((a ^ b) == kAllSoil && (a == 0 || b == 0)) {
      share_by_volume(grid, middle, h, b == 0 ? -h * h * h : h * h * h, gains);
      continue;
    }
    const auto mixed = [](std::uint64_t word) { return word != 0 && word != kAllSoil; };
    const double variance = error_m3 * error_m3 * (mixed(a) + mixed(b));
    const Vec3 half = Vec3::Constant(h / 2 - kBoxInset * grid.side_m.x());
    const Box low = grid.at(middle - half), high = grid.at(middle + half);
    const int sides = (low[0] != high[0]) + (low[1] != high[1]) + (low[2] != high[2]);
    if (sides == 0) {
      gains[low].add(
          {soil.sample_m3() * (std::popcount(b & ~a) - std::popcount(a & ~b)), variance});
      continue;
    }
    const CellPoints& points = sample_points(voxel);
    Gains shared;
    for (std::uint64_t left = a ^ b; left != 0; left &= left - 1) {
      const int i = std::countr_zero(left);
      const Vec3 p =
          middle + h * (Vec3(points.x[i], points.y[i], points.z[i]) - Vec3::Constant(0.5));
      shared[grid.at(p)].m3 += (b >> i & 1) != 0 ? soil.sample_m3() : -soil.sample_m3();
    }
    for (const auto& [box, gain] : shared)
      gains[box].add({gain.m3, variance + sides * error_m3 * error_m3});
  }
  return gains;
}

}  // namespace

Box GainGrid::at(const Vec3& p) const {
  const Vec3 i = ((p - origin).array() / side_m.array() + 0.5).floor();
  return {static_cast<int>(i.x()), static_cast<int>(i.y()), static_cast<int>(i.z())};
}

void Gain::add(const Gain& other) {
  m3 += other.m3;
  variance += other.variance;
}

void for_each_gain(const Soil& soil, const std::vector<Coord3>& chunks, const ReadChange& read,
                   const GainGrid& grid, const GainFunction& f) {
  for (std::size_t first = 0; first < chunks.size(); first += kGainChunks) {
    std::vector<Gains> batch(std::min(kGainChunks, chunks.size() - first));
    tbb::parallel_for(std::size_t{0}, batch.size(), [&](std::size_t i) {
      SampleWords before, after;
      read(chunks[first + i], before, after);
      batch[i] = gains_of(soil, chunks[first + i], before, after, grid);
    });
    for (const Gains& gains : batch)
      for (const auto& [box, gain] : gains) f(box, gain);
  }
}

void for_each_gain(const Soil& soil, const GainGrid& grid, const GainFunction& f,
                   const std::array<double, 2>& x_m) {
  std::vector<Coord3> origins;
  for (const Chunk* chunk : soil.chunks()) {
    const double low = soil.world_from_index(chunk->origin.cast<double>()).x();
    if (low + kChunkSide * soil.voxel_size_m() > x_m[0] && low - soil.voxel_size_m() < x_m[1])
      origins.push_back(chunk->origin);
  }
  const auto read = [&](const Coord3& origin, SampleWords& before, SampleWords& after) {
    soil.read_base(origin, before);
    soil.read_samples(origin, after);
  };
  for_each_gain(soil, origins, read, grid, f);
}

}  // namespace soilvdb::inline v0
