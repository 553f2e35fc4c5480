// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <openvdb/tools/Interpolation.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "core/soil_grids.h"

namespace soilvdb {
namespace {

class LevelSetSurface final : public BaseSurface {
 public:
  LevelSetSurface(openvdb::FloatGrid::ConstPtr grid, const Vec3& origin)
      : grid_(std::move(grid)),
        origin_(origin),
        voxel_(grid_->voxelSize().x()),
        bytes_(grid_->memUsage()) {
    const openvdb::CoordBBox box = grid_->evalActiveVoxelBoundingBox();
    const openvdb::Vec3d low = grid_->indexToWorld(box.min() - openvdb::Coord(1));
    const openvdb::Vec3d high = grid_->indexToWorld(box.max() + openvdb::Coord(1));
    box_ = Eigen::AlignedBox3d(origin_ + Vec3(low.x(), low.y(), low.z()),
                               origin_ + Vec3(high.x(), high.y(), high.z()));
  }

  std::uint64_t memory_bytes() const override { return bytes_; }

  Content classify(const Eigen::AlignedBox3d& box) const override {
    if (!box_.intersects(box)) return Content::kAir;
    const openvdb::Vec3d low = index(box.min()), high = index(box.max());
    const openvdb::CoordBBox cells(openvdb::Coord::floor(low), openvdb::Coord::ceil(high));
    constexpr openvdb::Index64 kMost = 64 * 64 * 64;
    if (cells.volume() > kMost) return Content::kMixed;
    auto values = grid_->getConstUnsafeAccessor();
    bool soil = false, air = false;
    for (auto c = cells.begin(); c != cells.end() && !(soil && air); ++c) {
      (values.getValue(*c) < 0 ? soil : air) = true;
    }
    return soil && air ? Content::kMixed : soil ? Content::kSoil : Content::kAir;
  }

  bool known(const Eigen::AlignedBox3d&) const override { return true; }

  void distance(const Vec3& first, double h, double band, float* phi) const override {
    const Sampler sampler(*grid_);
    for (int n = 0; n < kLeafSize; ++n) {
      const double d = at(sampler, first + h * Vec3(n >> 6, n >> 3 & 7, n & 7));
      phi[n] = static_cast<float>(std::clamp(d, -band, band));
    }
  }

  void samples(const Coord3& chunk, const Vec3& first, double h,
               SampleWords& words) const override {
    const Sampler sampler(*grid_);
    // A cell whose middle is farther from the surface than its corners are is all one; where the
    // band is narrower than that, each point counts.
    const double clear = h * 0.9;
    for (int n = 0; n < kLeafSize; ++n) {
      const Vec3 middle = first + h * Vec3(n >> 6, n >> 3 & 7, n & 7);
      const double d = at(sampler, middle);
      std::uint64_t bits = d < 0 ? kAllSoil : 0;
      if (std::abs(d) <= clear) {
        const CellPoints& points = sample_points(chunk + Coord3(n >> 6, n >> 3 & 7, n & 7));
        bits = 0;
        for (int i = 0; i < 64; ++i) {
          const Vec3 q(points.x[i] - 0.5, points.y[i] - 0.5, points.z[i] - 0.5);
          bits |= std::uint64_t{at(sampler, middle + h * q) < 0} << i;
        }
      }
      words[static_cast<std::size_t>(n)] = bits;
    }
  }

  std::optional<double> height(double x, double y) const override {
    const Sampler sampler(*grid_);
    double above = voxel_, z = box_.max().z();
    for (; z > box_.min().z(); z -= voxel_) {
      const double here = at(sampler, {x, y, z});
      if (here < 0) return z + voxel_ * here / (here - above);
      above = here;
    }
    return std::nullopt;
  }

 private:
  using Accessor = openvdb::FloatGrid::ConstUnsafeAccessor;

  /// Trilinear, one per call and thread.
  struct Sampler {
    explicit Sampler(const openvdb::FloatGrid& grid) : values(grid.getConstUnsafeAccessor()) {}
    double operator()(const openvdb::Vec3d& p) const {
      return openvdb::tools::BoxSampler::sample(values, p);
    }
    Accessor values;
  };

  openvdb::Vec3d index(const Vec3& p) const {
    const Vec3 local = p - origin_;
    return grid_->worldToIndex({local.x(), local.y(), local.z()});
  }
  double at(const Sampler& sampler, const Vec3& p) const { return sampler(index(p)); }

  openvdb::FloatGrid::ConstPtr grid_;
  Vec3 origin_;
  double voxel_;
  std::uint64_t bytes_;
  Eigen::AlignedBox3d box_;  // beyond it there is only air
};

}  // namespace

std::unique_ptr<BaseSurface> make_level_set_surface(openvdb::FloatGrid::ConstPtr grid,
                                                    const Vec3& origin) {
  if (grid->getGridClass() != openvdb::GRID_LEVEL_SET) {
    throw std::invalid_argument("the grid must be a level set, not class '" +
                                openvdb::GridBase::gridClassToString(grid->getGridClass()) + "'");
  }
  if (!grid->hasUniformVoxels() || !grid->transform().isLinear()) {
    throw std::invalid_argument("the grid must have cubic voxels");
  }
  if (grid->empty()) throw std::invalid_argument("the grid is empty");
  return std::make_unique<LevelSetSurface>(std::move(grid), origin);
}

}  // namespace soilvdb
