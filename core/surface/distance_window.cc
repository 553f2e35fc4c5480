// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface/distance_window.h"

#include <algorithm>

#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/lattice/chunk_math.h"
#include "core/lattice/lanes.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {
namespace {

Coord3 floor(const Vec3& p) { return p.array().floor().matrix().cast<int>(); }

/// 64 points in a window: the number of the voxel below each, and the distance beyond it.
struct Points {
  int low[64];
  double x[64], y[64], z[64];
};

/// A coordinate of points of a cell, computed as by Ground::index_from_world().
SOILVDB_INLINE void locate(const float* in_cell, double low, double h, double origin, double voxel,
                           int first, int step, double* part, int* number) {
  for (int i = 0; i < 64; ++i) {
    const double index = ((low + h * double{in_cell[i]}) - origin) / voxel;
    int below = static_cast<int>(index);
    below -= index < below;
    part[i] = index - below;
    number[i] += (below - first) * step;
  }
}

SOILVDB_FOR_CPUS void locate(const CellPoints& cell, const Vec3& low, double h,
                             const Ground& ground, const Coord3& first, const Coord3& step,
                             Points& points) {
  std::fill_n(points.low, 64, 0);
  const Vec3& origin = ground.origin();
  const double voxel = ground.voxel_size_m();
  locate(cell.x, low[0], h, origin[0], voxel, first[0], step[0], points.x, points.low);
  locate(cell.y, low[1], h, origin[1], voxel, first[1], step[1], points.y, points.low);
  locate(cell.z, low[2], h, origin[2], voxel, first[2], step[2], points.z, points.low);
}

SOILVDB_FOR_CPUS void blend(const float* distances, const Coord3& step, const Points& points,
                            double* sums) {
  std::fill_n(sums, 64, 0.0);
  for (int c = 0; c < 8; ++c) {
    const bool far[] = {(c & 4) != 0, (c & 2) != 0, (c & 1) != 0};
    const float* const corner = distances + far[0] * step[0] + far[1] * step[1] + far[2] * step[2];
    for (int i = 0; i < 64; ++i) {
      const double x = far[0] ? points.x[i] : 1 - points.x[i];
      const double y = far[1] ? points.y[i] : 1 - points.y[i];
      const double z = far[2] ? points.z[i] : 1 - points.z[i];
      sums[i] += x * y * z * double{corner[points.low[i]]};
    }
  }
}

}  // namespace

void DistanceWindow::read(GroundTiles::Reader& tiles, const Eigen::AlignedBox3d& box) {
  first_ = floor(box.min() - Vec3::Constant(kWindowRounding));
  size_ = floor(box.max() + Vec3::Constant(kWindowRounding)) - first_ + Coord3::Constant(2);
  distances_.resize(static_cast<std::size_t>(size_.prod()));
  flags_.resize(distances_.size());
  for_each_chunk(floor_to(first_, kChunkSide), first_ + size_ - Coord3::Ones(),
                 [&](const Coord3& chunk) { copy(tiles.tile(chunk), chunk); });
  for (const int step : {size_.y() * size_.z(), size_.z(), 1})
    for (std::size_t n = 0, to = static_cast<std::size_t>(step); to < flags_.size(); ++n, ++to)
      flags_[n] = static_cast<std::uint8_t>(flags_[n] | flags_[to]);
}

void DistanceWindow::copy(const GroundTiles::Tile* tile, const Coord3& chunk) {
  const Coord3 from = first_.cwiseMax(chunk);
  const Coord3 to = (first_ + size_).cwiseMin(chunk + Coord3::Constant(kChunkSide));
  for (int x = from.x(); x < to.x(); ++x)
    for (int y = from.y(); y < to.y(); ++y) {
      const int row = (x & 7) * kChunkSide + (y & 7);
      std::size_t n = place({x, y, from.z()});
      for (int z = from.z(); z < to.z(); ++z, ++n) {
        const int at = z & 7;
        distances_[n] = tile != nullptr ? tile->distance_m[row * kChunkSide + at] : 0.0f;
        flags_[n] = static_cast<std::uint8_t>(
            tile == nullptr ? int{kMissing}
                            : (tile->changed[row] >> at & 1) * int{kChanged} +
                                  (tile->different[row] >> at & 1) * int{kDifferent});
      }
    }
}

DistanceWindow::Value DistanceWindow::at(const Vec3& index) const {
  const Vec3 low = index.array().floor();
  const Coord3 cell = low.cast<int>();
  const Vec3 part = index - low;
  Value value{0, flags_[place(cell)]};
  for (int c = 0; c < 8; ++c) {
    const Coord3 step(c >> 2, c >> 1 & 1, c & 1);
    const std::size_t n = place(cell + step);
    double weight = 1;
    for (int a = 0; a < 3; ++a) weight *= step[a] != 0 ? part[a] : 1 - part[a];
    value.distance_m += weight * double{distances_[n]};
  }
  return value;
}

void DistanceWindow::at(const CellPoints& cell, const Vec3& low, double h, const Ground& ground,
                        std::uint64_t& changed, std::uint64_t& soil) const {
  const Coord3 step(size_.y() * size_.z(), size_.z(), 1);
  Points points;
  locate(cell, low, h, ground, first_, step, points);
  changed = soil = 0;
  for (int i = 0; i < 64; ++i)
    changed |= std::uint64_t{(flags_[static_cast<std::size_t>(points.low[i])] & kChanged) != 0}
               << i;
  if (changed == 0) return;
  double distances_m[64];
  blend(distances_.data(), step, points, distances_m);
  for (int i = 0; i < 64; ++i) soil |= std::uint64_t{distances_m[i] < 0} << i;
}

DistanceWindow::Common DistanceWindow::common(const Vec3& low, const Vec3& high) const {
  const Coord3 from = floor(low), to = floor(high) + Coord3::Ones();
  Common common;
  for (int x = from.x(); x <= to.x(); ++x)
    for (int y = from.y(); y <= to.y(); ++y) {
      std::size_t n = place({x, y, from.z()});
      for (int z = from.z(); z <= to.z(); ++z, ++n) {
        if (x < to.x() && y < to.y() && z < to.z()) {
          common.any |= flags_[n];
          common.all &= flags_[n];
        }
        (distances_[n] < 0 ? common.soil : common.air) = true;
      }
    }
  return common;
}

}  // namespace soilvdb::inline v0
