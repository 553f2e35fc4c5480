// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/ground/bilinear_patch.h"
#include "core/ground/ray_terrain.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::inline v0 {
namespace {

class Plane final : public InitialTerrain, public RayTerrain {
 public:
  Plane(double height_m, Vec2 slope)
      : height_(height_m), slope_(std::move(slope)), cosine_(1 / std::hypot(1.0, slope_.norm())) {}

  Content classify(const Eigen::AlignedBox3d& box) const override {
    const Vec2 half = box.sizes().head<2>() / 2;
    const double mid = at(box.center().x(), box.center().y());
    const double half_range = half.x() * std::abs(slope_.x()) + half.y() * std::abs(slope_.y());
    if (box.min().z() >= mid + half_range) return Content::kAir;
    if (box.max().z() < mid - half_range) return Content::kSoil;
    return Content::kMixed;
  }

  bool has_data(const Eigen::AlignedBox3d&) const override { return true; }

  void distance(const Vec3& first, double h, double band, float* phi) const override {
    for (int x = 0; x < kChunkSide; ++x) {
      for (int y = 0; y < kChunkSide; ++y) {
        const double ground = at(first.x() + h * x, first.y() + h * y);
        for (int z = 0; z < kChunkSide; ++z, ++phi) {
          const double d = (first.z() + h * z - ground) * cosine_;
          *phi = static_cast<float>(std::clamp(d, -band, band));
        }
      }
    }
  }

  void samples(const Coord3& chunk, const Vec3& first, double h,
               SampleWords& words) const override {
    const double half_range = h / 2 * (1 + slope_.cwiseAbs().sum());
    for (int column = 0; column < kChunkVoxels; column += kChunkSide) {
      const Coord3 at_bottom = numbered_voxel(column);
      const Vec3 bottom = first + h * at_bottom.cast<double>();
      const double ground = at(bottom.x(), bottom.y());
      for (int z = 0; z < kChunkSide; ++z) {
        std::uint64_t& word = words[static_cast<std::size_t>(column + z)];
        const double middle = first.z() + h * z, gap = middle - ground;
        if (std::abs(gap) > half_range) {
          word = gap < 0 ? kAllSoil : 0;
          continue;
        }
        // Relative to the cell, so float is enough.
        const double ground_over_low =
            at(bottom.x() - h / 2, bottom.y() - h / 2) - (middle - h / 2);
        word = points_below(sample_points(chunk + at_bottom + Coord3(0, 0, z)),
                            static_cast<float>(ground_over_low / h), static_cast<float>(slope_.x()),
                            static_cast<float>(slope_.y()), 0);
      }
    }
  }

  std::optional<double> height(double x, double y) const override { return at(x, y); }

  double meet(const Vec3& origin, const Vec3& direction, double from_m) const override {
    const Vec3 p = origin + from_m * direction;
    const double gap = p.z() - at(p.x(), p.y());
    if (gap <= 0) return from_m;
    const double sinks = slope_.dot(direction.head<2>()) - direction.z();
    return sinks > 0 ? from_m + gap / sinks : std::numeric_limits<double>::infinity();
  }

 private:
  double at(double x, double y) const { return height_ + slope_.x() * x + slope_.y() * y; }

  double height_;
  Vec2 slope_;
  double cosine_;
};

}  // namespace

std::unique_ptr<InitialTerrain> make_plane(double height_m, Vec2 slope) {
  return std::make_unique<Plane>(height_m, std::move(slope));
}

}  // namespace soilvdb::inline v0
