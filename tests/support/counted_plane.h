// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Terrain that tells how much of it was looked at.
#pragma once

#include <atomic>
#include <memory>
#include <optional>

#include "soilvdb/initial_terrain.h"

namespace soilvdb::test {

/// A plane that counts how often a chunk of it is asked for.
class CountedPlane final : public InitialTerrain {
 public:
  CountedPlane(double z_m, const Vec2& slope) : plane_(make_plane(z_m, slope)) {}
  Content classify(const Eigen::AlignedBox3d& box) const override { return plane_->classify(box); }
  bool has_data(const Eigen::AlignedBox3d&) const override { return true; }
  void distance(const Vec3& first, double h, double band, float* phi) const override {
    ++asked;
    plane_->distance(first, h, band, phi);
  }
  void samples(const Coord3& chunk, const Vec3& first, double h,
               SampleWords& words) const override {
    ++asked;
    plane_->samples(chunk, first, h, words);
  }
  std::optional<double> height(double x, double y) const override { return plane_->height(x, y); }

  mutable std::atomic<int> asked = 0;

 private:
  std::unique_ptr<InitialTerrain> plane_;
};

}  // namespace soilvdb::test
