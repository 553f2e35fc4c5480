// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/draw/cutout.h"

#include <openvdb/tools/SignedFloodFill.h>

#include <algorithm>
#include <cmath>

namespace soilvdb::inline v0::io {
namespace {

constexpr int kBand = 3;  // voxels

/// Heights in voxels above the underside, on columns that reach kBand beyond the relief.
class Columns {
 public:
  Columns(const Relief& relief, double bottom_m) : relief_(relief), bottom_m_(bottom_m) {}

  bool known(int i, int j) const {
    return i >= 0 && i < relief_.nx && j >= 0 && j < relief_.ny && !std::isnan(height(i, j));
  }
  /// j counts northwards, as y does.
  double height(int i, int j) const {
    return (relief_.height[relief_.at(i, relief_.ny - 1 - j)] - bottom_m_) / relief_.cell_x();
  }
  double cosine(int i, int j) const {
    const auto slope = [&](int di, int dj) {
      const int a = known(i + di, j + dj) ? 1 : 0, b = known(i - di, j - dj) ? 1 : 0;
      if (a + b == 0) return 0.0;
      return (height(i + a * di, j + a * dj) - height(i - b * di, j - b * dj)) / (a + b);
    };
    const double x = slope(1, 0), y = slope(0, 1);
    return 1 / std::sqrt(1 + x * x + y * y);
  }
  /// Voxels to the nearest column with (to_known) or without a height; kBand + 1 if it is farther.
  double distance(int i, int j, bool to_known, int& near_i, int& near_j) const {
    double best = kBand + 1;
    for (int dj = -kBand; dj <= kBand; ++dj) {
      for (int di = -kBand; di <= kBand; ++di) {
        const double d = std::hypot(di, dj);
        if (d < best && known(i + di, j + dj) == to_known) {
          best = d;
          near_i = i + di;
          near_j = j + dj;
        }
      }
    }
    return best;
  }

 private:
  const Relief& relief_;
  double bottom_m_;
};

}  // namespace

openvdb::FloatGrid::Ptr cutout_of_heights(const Relief& relief, double bottom_m,
                                          const Vec3& origin) {
  const double h = relief.cell_x();
  const Columns columns(relief, bottom_m);
  const auto grid = openvdb::FloatGrid::create(static_cast<float>(kBand * h));
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(h));
  const Vec2 first = relief.box.min() + Vec2::Constant(h / 2) - origin.head<2>();
  grid->transform().postTranslate(
      {first.x(), first.y(), bottom_m + relief.datum_m + h / 2 - origin.z()});
  auto voxels = grid->getAccessor();
  // The underside is at k = -0.5. Sides and underside are flat: distances run along one axis.
  for (int j = -kBand; j < relief.ny + kBand; ++j) {
    for (int i = -kBand; i < relief.nx + kBand; ++i) {
      const bool known = columns.known(i, j);
      int near_i = i, near_j = j;
      const double rim = columns.distance(i, j, !known, near_i, near_j) - 0.5;
      if (!known && rim > kBand) continue;
      const double side = known ? -rim : rim;
      if (known) near_i = i, near_j = j;
      const double top = columns.height(near_i, near_j) - 0.5;
      const double cosine = columns.cosine(near_i, near_j);
      const int high = static_cast<int>(std::ceil(top + kBand / cosine));
      for (int k = -kBand; k <= high; ++k) {
        const double phi = std::max({side, (k - top) * cosine, -0.5 - k});
        if (std::abs(phi) < kBand) {
          voxels.setValue({i, j, k}, static_cast<float>(phi * h));
        } else if (side < -kBand && k > kBand && (k - top) * cosine < -kBand) {
          k = std::max(k, static_cast<int>(std::floor(top - kBand / cosine)) - 1);
        }
      }
    }
  }
  openvdb::tools::signedFloodFill(grid->tree());
  return grid;
}

}  // namespace soilvdb::inline v0::io
