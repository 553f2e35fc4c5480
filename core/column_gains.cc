// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/column_gains.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <vector>

namespace soilvdb {
namespace {

using Column = ColumnGrid::Column;
using Gains = std::map<Column, Gain>;

constexpr double kHair = 1e-6;  // of a column, so that rounding shares no cell out

/// A cell that changed whole, by area.
void share_by_area(const ColumnGrid& grid, const Vec2& middle, double h, double m3, Gains& gains) {
  const Vec2 half = Vec2::Constant(h / 2), hair = Vec2::Constant(kHair * grid.side_m);
  const Column low = grid.at(middle - half + hair), high = grid.at(middle + half - hair);
  const auto overlap = [&](int column, int axis) {
    const double from = grid.origin[axis] + (column - 0.5) * grid.side_m;
    const double first = std::max(from, middle[axis] - h / 2);
    return (std::min(from + grid.side_m, middle[axis] + h / 2) - first) / h;
  };
  for (int x = low.first; x <= high.first; ++x)
    for (int y = low.second; y <= high.second; ++y) {
      const double part = (low.first == high.first ? 1 : overlap(x, 0)) *
                          (low.second == high.second ? 1 : overlap(y, 1));
      gains[{x, y}].m3 += part * m3;
    }
}

Gains gains_of(const Soil& soil, const Coord3& origin, const SampleWords& before,
               const SampleWords& after, const ColumnGrid& grid) {
  Gains gains;
  const double h = soil.voxel_size_m(), error_m3 = kCountError * h * h * h;
  for (int n = 0; n < kLeafSize; ++n) {
    const std::uint64_t a = before[static_cast<std::size_t>(n)];
    const std::uint64_t b = after[static_cast<std::size_t>(n)];
    if (a == b) continue;
    const Coord3 voxel = origin + Coord3(n >> 6, n >> 3 & 7, n & 7);
    const Vec2 middle = soil.world_from_index(voxel.cast<double>()).head<2>();
    if ((a ^ b) == kAllSoil && (a == 0 || b == 0)) {
      share_by_area(grid, middle, h, b == 0 ? -h * h * h : h * h * h, gains);
      continue;
    }
    const auto mixed = [](std::uint64_t word) { return word != 0 && word != kAllSoil; };
    const double variance = error_m3 * error_m3 * (mixed(a) + mixed(b));
    const Vec2 half = Vec2::Constant(h / 2 - kHair * grid.side_m);
    const Column low = grid.at(middle - half);
    if (low == grid.at(middle + half)) {
      gains[low].add(
          {soil.sample_m3() * (std::popcount(b & ~a) - std::popcount(a & ~b)), variance});
      continue;
    }
    const CellPoints& points = sample_points(voxel);
    Gains shared;
    for (std::uint64_t left = a ^ b; left != 0; left &= left - 1) {
      const int i = std::countr_zero(left);
      const Vec2 p = middle + h * Vec2(points.x[i] - 0.5, points.y[i] - 0.5);
      shared[grid.at(p)].m3 += (b >> i & 1) != 0 ? soil.sample_m3() : -soil.sample_m3();
    }
    for (const auto& [column, gain] : shared)
      gains[column].add({gain.m3, variance + error_m3 * error_m3});
  }
  return gains;
}

}  // namespace

Column ColumnGrid::at(const Vec2& p) const {
  const Vec2 i = (p - origin) / side_m;
  return {static_cast<int>(std::floor(i.x() + 0.5)), static_cast<int>(std::floor(i.y() + 0.5))};
}

void Gain::add(const Gain& other) {
  m3 += other.m3;
  variance += other.variance;
}

void for_each_gain(const Soil& soil, const std::vector<Coord3>& chunks, const ReadChange& read,
                   const ColumnGrid& grid, const GainFunction& f) {
  constexpr std::size_t kBatch = 4096;  // chunks
  for (std::size_t first = 0; first < chunks.size(); first += kBatch) {
    std::vector<Gains> batch(std::min(kBatch, chunks.size() - first));
    tbb::parallel_for(std::size_t{0}, batch.size(), [&](std::size_t i) {
      SampleWords before, after;
      read(chunks[first + i], before, after);
      batch[i] = gains_of(soil, chunks[first + i], before, after, grid);
    });
    for (const Gains& gains : batch)
      for (const auto& [column, gain] : gains) f(column, gain);
  }
}

void for_each_gain(const Soil& soil, const ColumnGrid& grid, const GainFunction& f) {
  std::vector<Coord3> origins;
  for (const Chunk* chunk : soil.chunks()) origins.push_back(chunk->origin);
  const auto read = [&](const Coord3& origin, SampleWords& before, SampleWords& after) {
    soil.read_base(origin, before);
    soil.read_samples(origin, after);
  };
  for_each_gain(soil, origins, read, grid, f);
}

}  // namespace soilvdb
