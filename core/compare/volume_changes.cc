// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/volume_changes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <map>
#include <vector>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::inline v0 {
namespace {

using Box = VolumeBins::Box;
using VolumeChanges = std::map<Box, VolumeChange>;

/// A cell that changed whole, by volume.
void share_by_volume(const VolumeBins& bins, const Vec3& middle, double h, double m3,
                     VolumeChanges& changes) {
  const Vec3 half = Vec3::Constant(h / 2 - kBoxInset * bins.side_m.x());
  const Box low = bins.at(middle - half), high = bins.at(middle + half);
  const auto part = [&](int box, std::size_t axis) {
    if (low[axis] == high[axis]) return 1.0;
    const auto a = static_cast<Eigen::Index>(axis);
    const double from = bins.origin[a] + (box - 0.5) * bins.side_m[a];
    const double first = std::max(from, middle[a] - h / 2);
    return (std::min(from + bins.side_m[a], middle[a] + h / 2) - first) / h;
  };
  for (int x = low[0]; x <= high[0]; ++x)
    for (int y = low[1]; y <= high[1]; ++y)
      for (int z = low[2]; z <= high[2]; ++z)
        changes[{x, y, z}].m3 += part(x, 0) * part(y, 1) * part(z, 2) * m3;
}

VolumeChanges volume_changes_of(const Ground& ground, const Coord3& origin,
                                const SampleWords& before, const SampleWords& after,
                                const VolumeBins& bins) {
  VolumeChanges changes;
  const double h = ground.voxel_size_m(), error_m3 = kWorstCountError * h * h * h;
  for (int n = 0; n < kChunkVoxels; ++n) {
    const std::uint64_t a = before[static_cast<std::size_t>(n)];
    const std::uint64_t b = after[static_cast<std::size_t>(n)];
    if (a == b) continue;
    const Coord3 voxel = origin + numbered_voxel(n);
    const Vec3 middle = ground.world_from_index(voxel.cast<double>());
    if ((a ^ b) == kAllSoil && (a == 0 || b == 0)) {
      share_by_volume(bins, middle, h, b == 0 ? -h * h * h : h * h * h, changes);
      continue;
    }
    const auto mixed = [](std::uint64_t word) { return word != 0 && word != kAllSoil; };
    const double variance = error_m3 * error_m3 * (mixed(a) + mixed(b));
    const Vec3 half = Vec3::Constant(h / 2 - kBoxInset * bins.side_m.x());
    const Box low = bins.at(middle - half), high = bins.at(middle + half);
    const int sides = (low[0] != high[0]) + (low[1] != high[1]) + (low[2] != high[2]);
    if (sides == 0) {
      changes[low].add(
          {ground.sample_m3() * (std::popcount(b & ~a) - std::popcount(a & ~b)), variance});
      continue;
    }
    const CellPoints& points = sample_points(voxel);
    VolumeChanges shared;
    for (std::uint64_t left = a ^ b; left != 0; left &= left - 1) {
      const int i = std::countr_zero(left);
      const Vec3 p =
          middle + h * (Vec3(points.x[i], points.y[i], points.z[i]) - Vec3::Constant(0.5));
      shared[bins.at(p)].m3 += (b >> i & 1) != 0 ? ground.sample_m3() : -ground.sample_m3();
    }
    for (const auto& [box, change] : shared)
      changes[box].add({change.m3, variance + sides * error_m3 * error_m3});
  }
  return changes;
}

}  // namespace

Box VolumeBins::at(const Vec3& p) const {
  const Vec3 i = ((p - origin).array() / side_m.array() + 0.5).floor();
  return {static_cast<int>(i.x()), static_cast<int>(i.y()), static_cast<int>(i.z())};
}

void VolumeChange::add(const VolumeChange& other) {
  m3 += other.m3;
  variance += other.variance;
}

void for_each_volume_change(const Ground& ground, const std::vector<Coord3>& chunks,
                            const ReadBeforeAndAfter& read, const VolumeBins& bins,
                            const VolumeChangeFunction& f) {
  for (std::size_t first = 0; first < chunks.size(); first += kGainChunks) {
    std::vector<VolumeChanges> batch(std::min(kGainChunks, chunks.size() - first));
    tbb::parallel_for(std::size_t{0}, batch.size(), [&](std::size_t i) {
      SampleWords before, after;
      read(chunks[first + i], before, after);
      batch[i] = volume_changes_of(ground, chunks[first + i], before, after, bins);
    });
    for (const VolumeChanges& changes : batch)
      for (const auto& [box, change] : changes) f(box, change);
  }
}

void for_each_volume_change(const Ground& ground, const VolumeBins& bins,
                            const VolumeChangeFunction& f, const std::array<double, 2>& x_m) {
  std::vector<Coord3> origins;
  for (const Chunk* chunk : ground.chunks()) {
    const double low = ground.world_from_index(chunk->origin.cast<double>()).x();
    if (low + kChunkSide * ground.voxel_size_m() > x_m[0] && low - ground.voxel_size_m() < x_m[1])
      origins.push_back(chunk->origin);
  }
  const auto read = [&](const Coord3& origin, SampleWords& before, SampleWords& after) {
    ground.read_base(origin, before);
    ground.read_samples(origin, after);
  };
  for_each_volume_change(ground, origins, read, bins, f);
}

}  // namespace soilvdb::inline v0
