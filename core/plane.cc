// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "core/base_surface.h"

namespace soilvdb {
namespace {

class Plane final : public BaseSurface {
 public:
  Plane(double height_m, Vec2 slope)
      : height_(height_m), slope_(std::move(slope)), cosine_(1 / std::hypot(1.0, slope_.norm())) {}

  Content classify(const Eigen::AlignedBox3d& box) const override {
    const Vec2 half = box.sizes().head<2>() / 2;
    const double mid = at(box.center().x(), box.center().y());
    const double reach = half.x() * std::abs(slope_.x()) + half.y() * std::abs(slope_.y());
    if (box.min().z() >= mid + reach) return Content::kAir;
    if (box.max().z() < mid - reach) return Content::kSoil;
    return Content::kMixed;
  }

  bool known(const Eigen::AlignedBox3d&) const override { return true; }

  void distance(const Vec3& first, double h, double band, float* phi) const override {
    for (int x = 0; x < kLeafSide; ++x) {
      for (int y = 0; y < kLeafSide; ++y) {
        const double ground = at(first.x() + h * x, first.y() + h * y);
        for (int z = 0; z < kLeafSide; ++z, ++phi) {
          const double d = (first.z() + h * z - ground) * cosine_;
          *phi = static_cast<float>(std::clamp(d, -band, band));
        }
      }
    }
  }

  std::uint64_t occupancy(const Vec3& low, double h, const CellPoints& points) const override {
    // Relative to the cell, so that float is enough.
    const float a = static_cast<float>((at(low.x(), low.y()) - low.z()) / h);
    const float sx = static_cast<float>(slope_.x()), sy = static_cast<float>(slope_.y());
    std::uint64_t bits = 0;
    for (int i = 0; i < 64; ++i) {
      bits |= std::uint64_t{points.z[i] < a + sx * points.x[i] + sy * points.y[i]} << i;
    }
    return bits;
  }

  std::optional<double> height(double x, double y) const override { return at(x, y); }

 private:
  double at(double x, double y) const { return height_ + slope_.x() * x + slope_.y() * y; }

  double height_;
  Vec2 slope_;
  double cosine_;
};

}  // namespace

std::unique_ptr<BaseSurface> make_plane(double height_m, Vec2 slope) {
  return std::make_unique<Plane>(height_m, std::move(slope));
}

}  // namespace soilvdb
