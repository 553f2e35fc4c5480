// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What base surfaces say of a place in one word, or refuse, is what their samples say one by one.
#include "soilvdb/initial_terrain.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <random>

#include "core/lattice/chunk_math.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/ground_grids.h"
#include "soilvdb/tracker.h"
#include "tests/support/spheres.h"

namespace soilvdb::test {
namespace initial_terrain_test {

class Holed final : public HeightSource {
 public:
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int y = y0; y < y0 + ny; ++y)
      for (int x = x0; x < x0 + nx; ++x)
        *out++ = x == 10 && y == 10 ? std::numeric_limits<float>::quiet_NaN() : 0.0f;
  }
};
TEST(HeightField, BeneathAHoleThereIsNoSoilHoweverDeep) {
  const HeightGrid grid{21, 21, {0, 0}, {1, 1}};
  const auto terrain = make_height_field(grid, std::make_shared<Holed>());
  for (const double z : {-0.3, -1.0, -10.0}) {
    float phi[kChunkVoxels];
    const Vec3 first(8.8, 9.9, z);
    terrain->distance(first, 0.1, 0.3, phi);
    for (int n = 0; n < kChunkVoxels; ++n) {
      const Vec3 p = first + 0.1 * numbered_voxel(n).cast<double>();
      const auto height = terrain->height(p.x(), p.y());
      EXPECT_EQ(phi[n] < 0, height && p.z() < *height) << p.transpose();
    }
  }
}

TEST(HeightField, ABodyIsNotPlacedWhereThereIsNoGround) {
  const HeightGrid grid{21, 21, {0, 0}, {1, 1}};
  Bucket bucket{0.4, 0.3, {{0, 0}, {-0.2, 0}, {0, 0.3}}, {}};
  Ground ground(0.1, Vec3::Zero(), make_height_field(grid, std::make_shared<Holed>()));
  Tracker tracker(ground, {bucket});
  EXPECT_THROW(tracker.update(0, Pose{{10, 10, -0.2}}), NoGroundError);
  EXPECT_EQ(ground.change_m3(), 0);
  EXPECT_NO_THROW(tracker.update(0, Pose{{5, 5, -0.2}}));
}

TEST(LevelSetSurface, WhatALevelSetCallsAChunkItsSamplesAre) {
  const Vec3 origin(1000, 2000, 100);
  const std::shared_ptr<const InitialTerrain> ball =
      make_level_set_surface(test::level_set_sphere(5.0f, {0, 0, 0}, 0.25f), origin);
  for (const double h : {0.25, 0.1}) {
    const Ground ground(h, origin, ball);
    int one = 0;
    for_each_chunk({Vec3::Constant(-6 / h), Vec3::Constant(6 / h)}, [&](const Coord3& chunk) {
      const Content content = ground.classify(chunk);
      if (content == Content::kMixed) return;
      SampleWords said, words;
      ground.read_base(chunk, said);
      ball->samples(chunk, ground.world_from_index(chunk.cast<double>()), h, words);
      EXPECT_EQ(said, words) << chunk.transpose();
      ++one;
    });
    EXPECT_GT(one, 10);
  }
}

TEST(Plane, SamplesAreSoilBelowAPlaneAndNowhereElse) {
  for (const Vec2& slope : {Vec2(0, 0), Vec2(0.3, -0.2), Vec2(1, 1), Vec2(-3, 2.5), Vec2(4, 4)}) {
    const auto plane = make_plane(0.013, slope);
    for (const Coord3& chunk : {Coord3(0, 0, 0), Coord3(-8, 0, -8), Coord3(0, -8, 0)}) {
      constexpr double h = 0.1;
      SampleWords words;
      plane->samples(chunk, h * chunk.cast<double>(), h, words);
      int wrong = 0;
      for (int n = 0; n < kChunkVoxels; ++n) {
        const Coord3 voxel = chunk + numbered_voxel(n);
        const CellPoints& points = sample_points(voxel);
        for (int i = 0; i < 64; ++i) {
          const Vec3 p = h * (voxel.cast<double>() - Vec3::Constant(0.5) +
                              Vec3(points.x[i], points.y[i], points.z[i]));
          const double above = p.z() - 0.013 - slope.dot(p.head<2>());
          if (std::abs(above) < 1e-5 * h) continue;
          wrong += (above < 0) != ((words[static_cast<std::size_t>(n)] >> i & 1) != 0);
        }
      }
      EXPECT_EQ(wrong, 0) << slope.transpose() << ", " << chunk.transpose();
    }
  }
}

TEST(GroundTerrain, ABoxThatGroundThatWasDugCallsAirOrSoilIs) {
  std::mt19937 random(4);
  const auto between = [&](double a, double b) {
    return std::uniform_real_distribution(a, b)(random);
  };
  int air = 0, soil = 0;
  for (int k = 0; k < 30; ++k) {
    const auto ground = std::make_shared<Ground>(
        1, Vec3::Zero(), make_plane(between(-1, 1), {between(-1, 1), between(-1, 1)}));
    Tracker tracker(*ground, {Bucket{between(2, 8), between(2, 8), {}, {}}});
    for (int i = 0; i < 4; ++i)
      tracker.update(0, {{between(-8, 8), between(-8, 8), between(-8, 2)},
                         from_rpy(between(-3, 3), between(-3, 3), between(-3, 3))});
    const auto dug = make_ground_terrain(ground);
    for (int n = 0; n < 4000; ++n) {
      const double side = between(0.05, 1.0), h = side / kChunkSide;
      const Vec3 low(between(-9, 9), between(-9, 9), between(-9, 3));
      const Content content = dug->classify({low, low + Vec3::Constant(side)});
      if (content == Content::kMixed) continue;
      ++(content == Content::kAir ? air : soil);
      SampleWords words, all;
      all.fill(content == Content::kAir ? 0 : kAllSoil);
      dug->samples(Coord3::Zero(), low + Vec3::Constant(h / 2), h, words);
      EXPECT_EQ(words, all) << low.transpose() << ", side " << side;
    }
  }
  EXPECT_GT(air, 1000);
  EXPECT_GT(soil, 1000);
}

TEST(ClosedLevelSet, AnExportedLevelSetHasAllOfItsBandBelowTheGround) {
  for (const double height : {0.41, 0.69, 0.71, 0.81, 0.97, 1.13}) {
    const Ground ground(0.1, Vec3::Zero(), make_plane(height, {0, 0}));
    const auto grid = closed_level_set(ground, {Vec3(-3, -3, -3), Vec3(3, 3, 3)});
    for (int k = -10; k <= 20; ++k)
      EXPECT_NEAR(grid->tree().getValue({0, 0, k}), std::clamp(0.1 * k - height, -0.3, 0.3), 1e-6)
          << height << " at " << k;
  }
}

}  // namespace initial_terrain_test
}  // namespace soilvdb::test
