// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <openvdb/tools/Interpolation.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/ground_grids.h"

namespace soilvdb::inline v0 {
namespace {

class LevelSetSurface final : public InitialTerrain {
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
    find_columns();
  }

  std::uint64_t memory_bytes() const override { return bytes_; }

  Content classify(const Eigen::AlignedBox3d& box) const override {
    if (!box_.intersects(box)) return Content::kAir;
    const openvdb::Vec3d low = index(box.min()), high = index(box.max());
    const openvdb::CoordBBox cells(openvdb::Coord::floor(low), openvdb::Coord::ceil(high));
    if (cells.volume() > kMaxClassifyVoxels) return Content::kMixed;
    auto values = grid_->getConstUnsafeAccessor();
    bool soil = false, air = false;
    for (auto c = cells.begin(); c != cells.end() && !(soil && air); ++c) {
      (values.getValue(*c) < 0 ? soil : air) = true;
    }
    return soil && air ? Content::kMixed : soil ? Content::kSoil : Content::kAir;
  }

  /// Sides and underside of a closed surface are not ground. The ground is known in columns of
  /// voxels with soil, from their lowest soil upwards, and above all ground near.
  bool has_data(const Eigen::AlignedBox3d& box) const override {
    const openvdb::Vec3d low = index(box.min()), high = index(box.max());
    if (low.z() >= highest_ + 1) return true;
    const openvdb::CoordBBox cells(openvdb::Coord::floor(low), openvdb::Coord::ceil(high));
    GroundExtent ground = look(cells, 0);
    if (ground.complete && low.z() >= ground.lowest) return true;
    for (int margin = kSide; margin <= kFarVoxels && ground.high == kNone; margin *= 2)
      ground = look(cells, margin);
    return ground.high != kNone && low.z() >= ground.high + 1;
  }

  void distance(const Vec3& first, double h, double band, float* phi) const override {
    const Sampler sampler(*grid_);
    for (int n = 0; n < kChunkVoxels; ++n) {
      const double d = at(sampler, first + h * numbered_voxel(n).cast<double>());
      phi[n] = static_cast<float>(std::clamp(d, -band, band));
    }
  }

  void samples(const Coord3& chunk, const Vec3& first, double h,
               SampleWords& words) const override {
    const Sampler sampler(*grid_);
    // A cell is all soil or all air if its middle is farther from the surface than its corners. If
    // the band is narrower than that, each point is tested.
    const double clear = h * kClearDistance;
    for (int n = 0; n < kChunkVoxels; ++n) {
      const Vec3 middle = first + h * numbered_voxel(n).cast<double>();
      const double d = at(sampler, middle);
      std::uint64_t bits = d < 0 ? kAllSoil : 0;
      if (std::abs(d) <= clear) {
        const CellPoints& points = sample_points(chunk + numbered_voxel(n));
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
  static constexpr int kSide = 8;  // voxels of a leaf
  static constexpr int kNone = std::numeric_limits<int>::min();

  /// The 8 x 8 columns of voxels of leaves above each other.
  struct Columns {
    std::uint64_t soil = 0;  ///< bit x * 8 + y: the column holds soil
    int lowest = kNone;      ///< largest over the columns of their lowest voxel of soil
    int high = kNone;        ///< highest voxel of soil
  };
  /// The known ground in columns around a box.
  struct GroundExtent {
    bool complete = true;  ///< all columns have soil
    int lowest = kNone, high = kNone;
  };

  static std::uint64_t key(int x, int y) {
    return std::uint64_t{std::uint32_t(x >> 3)} << 32 | std::uint32_t(y >> 3);
  }

  /// The surface is closed, so the leaves contain the ends of all soil.
  void find_columns() {
    std::unordered_map<std::uint64_t, std::array<int, kSide * kSide>> low;
    for (auto leaf = grid_->tree().cbeginLeaf(); leaf; ++leaf) {
      const openvdb::Coord& at = leaf->origin();
      Columns& columns = columns_[key(at.x(), at.y())];
      auto& lowest = low[key(at.x(), at.y())];
      for (int n = 0; n < kSide * kSide; ++n) {
        for (int z = 0; z < kSide; ++z) {
          if (!(leaf->getValue(static_cast<openvdb::Index>(n * kSide + z)) < 0)) continue;
          int& column = lowest[static_cast<std::size_t>(n)];
          if ((columns.soil >> n & 1) == 0 || at.z() + z < column) column = at.z() + z;
          columns.soil |= std::uint64_t{1} << n;
          columns.high = std::max(columns.high, at.z() + z);
        }
      }
    }
    for (auto& [at, columns] : columns_) {
      for (int n = 0; n < kSide * kSide; ++n)
        if (columns.soil >> n & 1)
          columns.lowest = std::max(columns.lowest, low[at][static_cast<std::size_t>(n)]);
      highest_ = std::max(highest_, columns.high);
    }
  }

  GroundExtent look(const openvdb::CoordBBox& cells, int margin) const {
    GroundExtent ground;
    const openvdb::Coord low = cells.min().offsetBy(-margin), high = cells.max().offsetBy(margin);
    for (int x = floor_to(low.x(), kSide); x <= high.x(); x += kSide) {
      for (int y = floor_to(low.y(), kSide); y <= high.y(); y += kSide) {
        const auto found = columns_.find(key(x, y));
        const Columns columns = found == columns_.end() ? Columns{} : found->second;
        ground.lowest = std::max(ground.lowest, columns.lowest);
        ground.high = std::max(ground.high, columns.high);
        for (int i = std::max(x, low.x()); i <= std::min(x + kSide - 1, high.x()); ++i)
          for (int j = std::max(y, low.y()); j <= std::min(y + kSide - 1, high.y()); ++j)
            ground.complete &= (columns.soil >> ((i & 7) * kSide + (j & 7)) & 1) != 0;
      }
    }
    return ground;
  }

  using Accessor = openvdb::FloatGrid::ConstUnsafeAccessor;

  /// Trilinear; one per call and thread.
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
  Eigen::AlignedBox3d box_;  // only air is beyond it
  std::unordered_map<std::uint64_t, Columns> columns_;
  int highest_ = kNone;
};

}  // namespace

std::unique_ptr<InitialTerrain> make_level_set_surface(openvdb::FloatGrid::ConstPtr grid,
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

}  // namespace soilvdb::inline v0
