// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground that was dug, as the base surface of ground with other voxels.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "core/base_surface.h"
#include "core/chunk_range.h"
#include "core/soil.h"
#include "core/surface.h"
#include "core/surface_height.h"

namespace soilvdb {
namespace {

/// Distances at the voxels of some chunks of the ground that was dug, trilinear between them.
class Window {
 public:
  /// @param box in index space
  Window(const Soil& ground, const Eigen::AlignedBox3d& box) {
    first_ = chunk_of(box.min() - Vec3::Constant(1));
    size_ = (chunk_of(box.max() + Vec3::Constant(1)) - first_) / kLeafSide + Coord3::Ones();
    cells_.resize(static_cast<std::size_t>(size_.prod()) * kLeafSize);
    changed_.resize(cells_.size());
    std::size_t at = 0;
    SampleWords now, base;
    for (int x = 0; x < size_.x(); ++x)
      for (int y = 0; y < size_.y(); ++y)
        for (int z = 0; z < size_.z(); ++z, at += kLeafSize) {
          const Coord3 origin = first_ + kLeafSide * Coord3(x, y, z);
          surface_distance(ground, origin, &cells_[at]);
          if (ground.find(origin) == nullptr) continue;
          ground.read_samples(origin, now);
          ground.read_base(origin, base);
          for (std::size_t n = 0; n < kLeafSize; ++n) changed_[at + n] = now[n] != base[n];
        }
  }

  struct Value {
    double distance_m;
    bool changed;  ///< somebody dug in one of the cells about
  };
  Value at(const Vec3& index) const {
    const Vec3 low = index.array().floor();
    const Coord3 cell = low.cast<int>();
    const Vec3 part = index - low;
    Value value{0, false};
    for (int c = 0; c < 8; ++c) {
      const Coord3 step(c >> 2, c >> 1 & 1, c & 1);
      const std::size_t n = place(cell + step);
      double weight = 1;
      for (int a = 0; a < 3; ++a) weight *= step[a] != 0 ? part[a] : 1 - part[a];
      value.distance_m += weight * double{cells_[n]};
      value.changed |= changed_[n] != 0;
    }
    return value;
  }

 private:
  std::size_t place(const Coord3& cell) const {
    const Coord3 local = cell - first_;
    const Coord3 chunk = local / kLeafSide;
    const int c = (chunk.x() * size_.y() + chunk.y()) * size_.z() + chunk.z();
    return static_cast<std::size_t>(c * kLeafSize + (local.x() & 7) * 64 + (local.y() & 7) * 8 +
                                    (local.z() & 7));
  }

  Coord3 first_, size_;
  std::vector<float> cells_;
  std::vector<std::uint8_t> changed_;
};

class SoilSurface final : public BaseSurface {
 public:
  explicit SoilSurface(std::shared_ptr<const Soil> ground)
      : ground_(std::move(ground)), heights_(surface_heights(*ground_)) {}

  Content classify(const Eigen::AlignedBox3d& box) const override {
    constexpr double kMost = 4096;  // chunks that are looked at
    const Content base = ground_->base().classify(box);
    // The surface leaves the cells that hold it by less than a voxel.
    const Eigen::AlignedBox3d cells = indices(box, 1);
    if ((cells.sizes() / kLeafSide).array().ceil().prod() > kMost)
      return ground_->chunk_count() == 0 || (base == Content::kAir && ground_->is_air(box))
                 ? base
                 : Content::kMixed;
    bool resident = false;
    for_each_chunk(cells, [&](const Coord3& at) { resident |= ground_->find(at) != nullptr; });
    if (!resident) return base;
    bool soil = false, air = false;
    for_each_chunk(cells, [&](const Coord3& at) {
      if (!(soil && air)) look(at, cells, soil, air);
    });
    return soil && air ? Content::kMixed : soil ? Content::kSoil : Content::kAir;
  }

  bool known(const Eigen::AlignedBox3d& box) const override { return ground_->base().known(box); }

  void distance(const Vec3& first, double h, double band, float* phi) const override {
    ground_->base().distance(first, h, band, phi);
    const Eigen::AlignedBox3d box = indices(voxels(first, h), 0);
    if (!is_dug(box)) return;
    const Window window(*ground_, box);
    for (int n = 0; n < kLeafSize; ++n) {
      const Vec3 p = first + h * Vec3(n >> 6, n >> 3 & 7, n & 7);
      const double d = window.at(ground_->index_from_world(p)).distance_m;
      // Beyond the band of the ground it says no more than which side it is.
      if (std::abs(d) >= ground_->band_m() && (d < 0) == (phi[n] < 0)) continue;
      phi[n] = static_cast<float>(std::clamp(d, -band, band));
    }
  }

  void samples(const Coord3& chunk, const Vec3& first, double h,
               SampleWords& words) const override {
    ground_->base().samples(chunk, first, h, words);
    const Eigen::AlignedBox3d box = indices(voxels(first, h), 0);
    if (!is_dug(box)) return;
    const Window window(*ground_, box);
    for (int n = 0; n < kLeafSize; ++n) {
      const Coord3 cell(n >> 6, n >> 3 & 7, n & 7);
      const CellPoints& points = sample_points(chunk + cell);
      const Vec3 low = first + h * (cell.cast<double>() - Vec3::Constant(0.5));
      std::uint64_t& word = words[static_cast<std::size_t>(n)];
      for (int i = 0; i < 64; ++i) {
        const Vec3 p = low + h * Vec3(points.x[i], points.y[i], points.z[i]);
        const Window::Value value = window.at(ground_->index_from_world(p));
        if (!value.changed) continue;
        const std::uint64_t bit = std::uint64_t{1} << i;
        word = value.distance_m < 0 ? word | bit : word & ~bit;
      }
    }
  }

  std::uint64_t memory_bytes() const override { return ground_->memory_bytes(); }
  void forget() const override { ground_->base().forget(); }
  std::optional<double> height(double x, double y) const override { return heights_(x, y); }
  const Soil* soil() const override { return ground_.get(); }

 private:
  /// The box of a chunk's cells.
  static Eigen::AlignedBox3d voxels(const Vec3& first, double h) {
    return {first - Vec3::Constant(h / 2), first + Vec3::Constant(h * (kLeafSide - 0.5))};
  }
  Eigen::AlignedBox3d indices(const Eigen::AlignedBox3d& box, double margin) const {
    return {ground_->index_from_world(box.min()) - Vec3::Constant(margin),
            ground_->index_from_world(box.max()) + Vec3::Constant(margin)};
  }
  bool is_dug(const Eigen::AlignedBox3d& box) const {
    const Vec3 margin = Vec3::Constant(1);
    bool found = false;
    for_each_chunk({box.min() - margin, box.max() + margin},
                   [&](const Coord3& origin) { found |= ground_->find(origin) != nullptr; });
    return found;
  }
  /// Whether a chunk has soil and air in a box of index space.
  void look(const Coord3& origin, const Eigen::AlignedBox3d& box, bool& soil, bool& air) const {
    const Vec3 half = Vec3::Constant(0.5), first = origin.cast<double>();
    const Eigen::AlignedBox3d part =
        box.intersection({first - half, first + Vec3::Constant(kLeafSide - 0.5)});
    if (ground_->find(origin) == nullptr) {
      const Content content = ground_->base().classify(
          {ground_->world_from_index(part.min()), ground_->world_from_index(part.max())});
      soil |= content != Content::kAir;
      air |= content != Content::kSoil;
      return;
    }
    SampleWords words;
    ground_->read_samples(origin, words);
    const Coord3 low = (part.min() + half - first).array().floor().max(0).matrix().cast<int>();
    const Coord3 high =
        (part.max() + half - first).array().floor().min(kLeafSide - 1).matrix().cast<int>();
    for (int x = low.x(); x <= high.x(); ++x)
      for (int y = low.y(); y <= high.y(); ++y)
        for (int z = low.z(); z <= high.z(); ++z) {
          const std::uint64_t word = words[static_cast<std::size_t>(x * 64 + y * 8 + z)];
          soil |= word != 0;
          air |= word != kAllSoil;
        }
  }

  std::shared_ptr<const Soil> ground_;
  std::function<std::optional<double>(double, double)> heights_;
};

}  // namespace

std::unique_ptr<BaseSurface> make_soil_surface(std::shared_ptr<const Soil> ground) {
  return std::make_unique<SoilSurface>(std::move(ground));
}

}  // namespace soilvdb
