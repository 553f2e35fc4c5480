// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground that was dug as the base surface of ground with other voxels.
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/surface.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/tracker.h"
#include "tests/support/counted_plane.h"
#include "tests/support/difference_fixture.h"

namespace soilvdb {
namespace ground_terrain_test {

constexpr double kVoxel = 0.05;

/// A trench 2 m long.
class DugGround : public ::testing::Test {
 protected:
  void SetUp() override {
    Bucket bucket;
    bucket.width_m = 0.6;
    bucket.height_m = 1;
    Tracker tracker(*ground_, {bucket});
    for (int i = 0; i <= 20; ++i)
      tracker.update(0, {{0.1 * i, 0.05 * i, -0.02 * i}, from_rpy(0.1, 0.2, 0.4)});
  }
  std::vector<Coord3> chunks(double h) const {
    std::vector<Coord3> all;
    for_each_chunk({Vec3(-0.5, -0.8, -1) / h, Vec3(2.5, 1.6, 0.8) / h},
                   [&](const Coord3& chunk) { all.push_back(chunk); });
    return all;
  }
  std::unique_ptr<InitialTerrain> surface() const { return make_ground_terrain(ground_); }

  const std::shared_ptr<test::CountedPlane> base_ =
      std::make_shared<test::CountedPlane>(0.013, Vec2(0.1, -0.2));
  const std::shared_ptr<Ground> ground_ = std::make_shared<Ground>(kVoxel, Vec3::Zero(), base_);
};

/// What a base surface says of a chunk.
struct Said {
  SampleWords words;
  std::array<float, kChunkVoxels> distance_m;
  Said(const InitialTerrain& surface, double h, const Coord3& chunk) {
    const Vec3 first = h * chunk.cast<double>();
    surface.samples(chunk, first, h, words);
    surface.distance(first, h, 3 * h, distance_m.data());
  }
  bool operator==(const Said&) const = default;
};

TEST_F(DugGround, SaysTheSameInAnyOrderOnAnyThreadsAndAfterItForgot) {
  for (const double h : {0.035, 0.07, 0.25}) {
    const auto all = chunks(h);
    const auto in_order = surface(), back = surface(), parallel = surface();
    std::vector<Said> said;
    for (const Coord3& chunk : all) said.emplace_back(*in_order, h, chunk);
    for (std::size_t i = all.size(); i-- > 0;) {
      if (i % 7 == 0) back->forget();
      ASSERT_EQ(Said(*back, h, all[i]), said[i]) << h << " " << all[i].transpose();
    }
    const tbb::global_control threads(tbb::global_control::max_allowed_parallelism, 4);
    std::atomic<int> others = 0;
    tbb::parallel_for(std::size_t{0}, all.size(),
                      [&](std::size_t i) { others += !(Said(*parallel, h, all[i]) == said[i]); });
    EXPECT_EQ(others, 0) << h;
  }
}

TEST_F(DugGround, IsLookedAtOnceHoweverOftenItIsAsked) {
  for (const double h : {0.02, 0.1, 2.0, 100.0}) {
    const auto all = chunks(h);
    const auto dug = surface();
    const auto ask = [&] {
      const int before = base_->asked;
      for (const Coord3& chunk : all) Said(*dug, h, chunk);
      return base_->asked - before;
    };
    const int first = ask(), again = ask();
    // What the base says where nobody dug: one call for samples and one for distances.
    EXPECT_EQ(again, 2 * static_cast<int>(all.size())) << h;
    // Blocks look two chunks beyond their 4 x 4 x 4: at up to 8 times as many, two or three calls
    // for each. One block for every chunk would be 125 times.
    const int near = 27 * static_cast<int>(ground_->chunk_count());
    EXPECT_LT(first - again, 3 * 8 * near) << h;
  }
}

TEST_F(DugGround, HoldsWhatItMadeUntilItForgets) {
  const auto dug = surface();
  const std::uint64_t before = dug->memory_bytes();
  for (const Coord3& chunk : chunks(0.1)) Said(*dug, 0.1, chunk);
  const std::uint64_t tile = kChunkVoxels * sizeof(float);
  EXPECT_GT(dug->memory_bytes(), before + ground_->chunk_count() * tile);
  EXPECT_LT(dug->memory_bytes(), before + 27 * ground_->chunk_count() * 2 * tile);
  dug->forget();
  EXPECT_EQ(dug->memory_bytes(), before);
}

TEST_F(DugGround, IsTheBaseSurfaceToTheBitBesideWhatWasDug) {
  const double h = 0.07;
  const auto dug = surface();
  int same = 0, other = 0;
  for (const Coord3& chunk : chunks(h)) {
    const Said now(*dug, h, chunk), was(*base_, h, chunk);
    for (int n = 0; n < kChunkVoxels; ++n) {
      const Vec3 p = h * (chunk + numbered_voxel(n)).cast<double>();
      // The trench is within 0.3 m of its axis, and a bucket's tilt.
      const double across = std::abs(p.y() * std::cos(0.464) - p.x() * std::sin(0.464));
      const bool far = across > 0.3 + 0.1 + 8 * kVoxel;
      const auto i = static_cast<std::size_t>(n);
      if (far) {
        EXPECT_EQ(now.distance_m[i], was.distance_m[i]);
        EXPECT_EQ(now.words[i], was.words[i]);
      }
      (now.words[i] == was.words[i] ? same : other) += 1;
    }
  }
  EXPECT_GT(same, 0);
  EXPECT_GT(other, 0);
}

TEST(GroundTerrain, HasTheGroundsOwnDistancesInItsVoxelsOnAllSidesOfWhatWasDug) {
  const auto ground = std::make_shared<Ground>(1, Vec3::Zero(), make_plane(100, {0, 0}));
  SampleWords all;
  all.fill(kAllSoil);
  GroundWriter(*ground).remove(Coord3::Zero(), all);
  const auto dug = make_ground_terrain(ground);
  for (int n = 0; n < 27; ++n) {
    const Coord3 chunk = kChunkSide * step_around(n);
    std::array<float, kChunkVoxels> own, now;
    surface_distance(*ground, chunk, own.data());
    dug->distance(chunk.cast<double>(), 1, ground->band_m(), now.data());
    EXPECT_EQ(own, now) << chunk.transpose();
  }
}

/// Soil in a box of both, m^3.
double soil_m3(const Ground& ground, const Eigen::AlignedBox3d& box) {
  std::int64_t count = 0;
  const double h = ground.voxel_size_m();
  SampleWords words;
  for (double x = box.min().x(); x < box.max().x() - h / 2; x += 8 * h)
    for (double y = box.min().y(); y < box.max().y() - h / 2; y += 8 * h)
      for (double z = box.min().z(); z < box.max().z() - h / 2; z += 8 * h) {
        const Vec3 first = ground.index_from_world(Vec3(x, y, z) + Vec3::Constant(h / 2));
        ground.read_samples(first.array().round().matrix().cast<int>(), words);
        for (const std::uint64_t word : words) count += std::popcount(word);
      }
  return static_cast<double>(count) * ground.sample_m3();
}

TEST(GroundTerrain, HoldsTheVolumeOfTheGroundItIsOf) {
  const auto terrain = plane(0.013);
  auto dug = std::make_shared<Ground>(0.05, Vec3::Constant(0.025), terrain);
  HalfSine trench;
  trench.yaw = 0.4;
  trench.dig(*dug);
  const Eigen::AlignedBox3d box(Vec3(-1.6, -1.6, -1.6), Vec3(3.2, 3.2, 1.6));
  const double before = soil_m3(*dug, box), cut = -dug->change_m3();
  for (const double h : {0.025, 0.1, 0.2}) {
    const Ground ground(h, Vec3::Constant(h / 2), make_ground_terrain(dug));
    // Half a voxel of the ground that was dug, on all that was dug, is what is promised.
    EXPECT_NEAR(soil_m3(ground, box), before, 0.02 * cut) << h;
  }
}

TEST(GroundTerrain, IsTheGroundsOwnBaseWhereNobodyDug) {
  const auto terrain = plane(0.013, {0.2, 0.1});
  auto dug = std::make_shared<Ground>(0.05, Vec3::Zero(), terrain);
  HalfSine().dig(*dug);
  const Ground on_it(0.1, Vec3::Zero(), make_ground_terrain(dug)), own(0.1, Vec3::Zero(), terrain);
  SampleWords a, b;
  for (int z = -16; z <= 16; z += 8) {
    const Coord3 far(80, 80, z);
    on_it.read_samples(far, a);
    own.read_samples(far, b);
    EXPECT_EQ(a, b);
  }
  EXPECT_EQ(*on_it.terrain().height(20, 20), *terrain->height(20, 20));
  EXPECT_TRUE(on_it.is_air({Vec3(0.9, -0.1, -0.2), Vec3(1.1, 0.1, 1)}));
  EXPECT_FALSE(on_it.is_air({Vec3(0.9, -0.1, -0.5), Vec3(1.1, 0.1, 1)}));
  EXPECT_EQ(on_it.terrain().classify({Vec3(0.9, -0.1, -0.8), Vec3(1.1, 0.1, -0.6)}),
            Content::kSoil);
}

}  // namespace ground_terrain_test
}  // namespace soilvdb
