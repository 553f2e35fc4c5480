// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/column_change.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace soilvdb {
namespace {

/// Shares smaller than this are rounding of a border that lies on another, voxels.
constexpr double kBorder = 1e-6;

using Columns = std::array<int, kLeafSide * kLeafSide>;  // samples

Columns change_of(const Soil& soil, const Coord3& origin) {
  SampleWords now, base;
  soil.read_samples(origin, now);
  soil.read_base(origin, base);
  Columns columns{};
  for (std::size_t n = 0; n < now.size(); ++n) {
    columns[n / kLeafSide] += std::popcount(now[n]) - std::popcount(base[n]);
  }
  return columns;
}

/// The cells that a voxel's width meets along one axis, and how much of it is in each.
struct Overlap {
  int first = 0, count = 0;
  std::array<double, 2> few{};
  std::vector<double> many;
  double operator[](int k) const {
    return many.empty() ? few[static_cast<std::size_t>(k)] : many[static_cast<std::size_t>(k)];
  }
  /// @param low, high the voxel's sides in cells from the raster's low side
  Overlap(double low, double high) {
    const double slack = kBorder * (high - low);
    first = static_cast<int>(std::floor(low + slack));
    const int last = std::max(static_cast<int>(std::ceil(high - slack)) - 1, first);
    count = last - first + 1;
    if (count > 2) many.resize(static_cast<std::size_t>(count));
    double left = 1;
    for (int k = 0; k < count; ++k) {
      const double share =
          k + 1 == count ? left : (first + k + 1 - std::max(low, double(first + k))) / (high - low);
      (count > 2 ? many[static_cast<std::size_t>(k)] : few[static_cast<std::size_t>(k)]) = share;
      left -= share;
    }
  }
};

}  // namespace

std::vector<double> column_change_m(const Soil& soil, const HeightGrid& grid) {
  const std::vector<const Chunk*> chunks = soil.chunks();
  std::vector<Columns> changes(chunks.size());
  tbb::parallel_for(std::size_t{0}, chunks.size(),
                    [&](std::size_t i) { changes[i] = change_of(soil, chunks[i]->origin); });
  std::vector<double> heights(static_cast<std::size_t>(grid.nx) *
                              static_cast<std::size_t>(grid.ny));
  const double h = soil.voxel_size_m();
  const Vec2 low = grid.first - grid.spacing / 2;
  const double scale = soil.sample_m3() / grid.spacing.prod();
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    for (int c = 0; c < kLeafSide * kLeafSide; ++c) {
      const int samples = changes[i][static_cast<std::size_t>(c)];
      if (samples == 0) continue;
      const Coord3 voxel = chunks[i]->origin + Coord3(c / kLeafSide, c % kLeafSide, 0);
      const Vec2 from =
          soil.world_from_index(voxel.cast<double>()).head<2>() - Vec2::Constant(h / 2) - low;
      const Overlap x(from.x() / grid.spacing.x(), (from.x() + h) / grid.spacing.x());
      const Overlap y(from.y() / grid.spacing.y(), (from.y() + h) / grid.spacing.y());
      for (int q = 0; q < y.count; ++q) {
        for (int p = 0; p < x.count; ++p) {
          const int ix = x.first + p, iy = y.first + q;
          if (ix < 0 || iy < 0 || ix >= grid.nx || iy >= grid.ny) continue;
          heights[static_cast<std::size_t>(iy) * static_cast<std::size_t>(grid.nx) +
                  static_cast<std::size_t>(ix)] += samples * scale * x[p] * y[q];
        }
      }
    }
  }
  return heights;
}

}  // namespace soilvdb
