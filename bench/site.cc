// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "bench/site.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace soilvdb::bench {
namespace {

constexpr double kPost_m = 0.5;

class Hills : public HeightSource {
 public:
  explicit Hills(Vec2 first) : first_(first) {}
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int j = 0; j < ny; ++j) {
      for (int i = 0; i < nx; ++i) {
        *out++ = static_cast<float>(
            hill_height(first_.x() + kPost_m * (x0 + i), first_.y() + kPost_m * (y0 + j)));
      }
    }
  }

 private:
  Vec2 first_;
};

/// From 0 to 1 with no jump in speed.
double ease(double s) {
  s = std::clamp(s, 0.0, 1.0);
  return s * s * (3 - 2 * s);
}

}  // namespace

double hill_height(double x, double y) {
  return 4 * std::sin(x / 41) * std::cos(y / 37) + 1.5 * std::sin(x / 13 + y / 17) +
         0.3 * std::sin(x / 3.1) * std::sin(y / 2.7);
}

std::shared_ptr<const InitialTerrain> make_hills(double side_m) {
  HeightGrid grid;
  grid.nx = grid.ny = static_cast<int>(std::ceil(side_m / kPost_m)) + 1;
  grid.first = Vec2::Constant(-side_m / 2);
  grid.spacing = Vec2::Constant(kPost_m);
  return make_height_field(grid, std::make_shared<Hills>(grid.first));
}

Bucket excavator_bucket() {
  Bucket bucket;
  bucket.width_m = 1.2;
  bucket.height_m = 0.8;
  return bucket;
}

Pose DigCycles::world_from_bucket(double time_s) const {
  constexpr double kNear_m = 4.5, kFar_m = 8, kLift_m = 3, kAdvance_m = 1.5, kRow_m = 60;
  const double cycles = std::max(time_s, 0.0) / kCycle_s;
  const int cycle = static_cast<int>(cycles), place = cycle / kCyclesPerPlace;
  const int turn = cycle % kCyclesPerPlace;
  const double t = (cycles - cycle) * kCycle_s;

  // Where it stands: rows of 60 m, 6 m apart.
  const double along = std::fmod(place * kAdvance_m, kRow_m);
  const double beside = 6 * std::floor(place * kAdvance_m / kRow_m);
  const Eigen::Rotation2Dd world_from_track(heading_rad_);
  const Vec2 stand = start_ + world_from_track * Vec2(-along, beside);

  // Five strokes side by side, then the same again deeper.
  const double swing_dig = heading_rad_ + 0.3 * (turn % 5 - 2);
  const double depth = 0.35 * (1 + turn / 5);
  const double back = ease((t - kDig_s) / 1.5);                                 // lifting
  const double away = ease((t - kDig_s - 1) / 4) - ease((t - kDig_s - 8) / 5);  // swinging
  const double swing = swing_dig + 1.6 * away;
  const double s = std::clamp(t / kDig_s, 0.0, 1.0);
  const double down = 1 - ease((t - (kCycle_s - 1)));  // coming back
  const double radius = kFar_m + (kNear_m - kFar_m) * s * (t < kDig_s ? 1 : 1 - ease((t - 13) / 5));
  const double lift = kLift_m * back * down;
  const double curl = -0.5 + 1.4 * s * (t < kDig_s ? 1 : 1 - ease((t - 9) / 3));

  const Vec2 dug = stand + radius * Vec2(std::cos(swing_dig), std::sin(swing_dig));
  const Vec2 lip = stand + radius * Vec2(std::cos(swing), std::sin(swing));
  Pose pose;
  const double cut = t < kDig_s ? depth * std::sin(std::numbers::pi * s) : 0;
  pose.position << lip, hill_height(dug.x(), dug.y()) + 0.1 + lift - cut - 0.1 * (t < kDig_s);
  // The mouth looks back at the machine; curling turns it up.
  pose.rotation = from_rpy(0, -curl, swing + std::numbers::pi);
  return pose;
}

std::vector<DigCycles> fleet() {
  std::vector<DigCycles> all;
  for (int i = 0; i < 10; ++i) {
    all.emplace_back(Vec2(-400 + 180 * (i % 5), -200 + 400 * (i / 5)), 0.37 * i);
  }
  return all;
}

}  // namespace soilvdb::bench
