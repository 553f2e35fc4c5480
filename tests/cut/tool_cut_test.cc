// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Tools of any shape: against the exact sweep of a box, closed forms, and laws.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "core/cut/excavator.h"
#include "soilvdb/ground_grids.h"
#include "soilvdb/motion.h"
#include "soilvdb/tool_shape.h"
#include "tests/support/sanitized.h"
#include "tests/support/spheres.h"

namespace soilvdb::test {
namespace tool_cut_test {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr double kVoxel = 0.05, kPi = std::numbers::pi;

/// A box, or with more corners a prism about z.
Mesh prism(const std::vector<Vec2>& outline, double low, double high) {
  Mesh mesh;
  const auto n = static_cast<std::uint32_t>(outline.size());
  for (const double z : {low, high})
    for (const Vec2& p : outline) mesh.points.emplace_back(Vec3(p.x(), p.y(), z).cast<float>());
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t k = (i + 1) % n;
    mesh.triangles.push_back({i, k, n + k});
    mesh.triangles.push_back({i, n + k, n + i});
    if (i == 0 || k == 0) continue;
    mesh.triangles.push_back({0, k, i});
    mesh.triangles.push_back({n, n + i, n + k});
  }
  return mesh;
}

Mesh box(const Vec3& low, const Vec3& high) {
  return prism({{low.x(), low.y()}, {high.x(), low.y()}, {high.x(), high.y()}, {low.x(), high.y()}},
               low.z(), high.z());
}

Mesh cylinder(double radius, double low, double high) {
  std::vector<Vec2> outline;
  for (int i = 0; i < 64; ++i)
    outline.emplace_back(radius * std::cos(2 * kPi * i / 64), radius * std::sin(2 * kPi * i / 64));
  return prism(outline, low, high);
}

std::unique_ptr<Ground> flat(double height_m = 0) {
  return std::make_unique<Ground>(kVoxel, Vec3(500'000, 4'000'000, 0),
                                  make_plane(height_m, {0, 0}));
}

Vec3 near(const Ground& ground, double x, double y, double z) {
  return ground.origin() + Vec3(x, y, z);
}

double volume_m3(const Ground& ground, const ToolCut& cut) {
  return static_cast<double>(cut.samples) * ground.sample_m3();
}

TEST(ToolCut, OfABoxIsThatOfItsExactSweep) {
  const Bucket bucket{0.8, 0.5, {{0, 0}, {-0.4, 0}, {-0.4, 0.5}, {0, 0.5}}, {}};
  const ToolShape tool(box({-0.4, -0.4, 0}, {0, 0.4, 0.5}), kVoxel / 2);
  std::mt19937 random(3);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution(low, high)(random);
  };
  for (int i = 0; i < (kLong ? 6 : kSanitized ? 1 : 2); ++i) {
    SCOPED_TRACE(i);
    const auto exact = flat(), by_shape = flat();
    std::vector<Pose> path = {{near(*exact, 0, 0, 0.7), from_rpy(0, 0, between(-3, 3))}};
    Vec3 at(0, 0, -0.5);
    for (int k = 0; k < 5; ++k) {
      path.push_back({near(*exact, at.x(), at.y(), at.z()),
                      from_rpy(between(-0.6, 0.6), between(-1, 1), between(-3, 3))});
      at += Vec3(between(-0.8, 0.8), between(-0.8, 0.8), between(-0.2, 0.2));
    }
    std::vector<Pose> traced = {path[0]};
    for (std::size_t k = 1; k < path.size(); ++k)
      trace(path[k - 1], path[k], bucket, 0.02 * kVoxel, 16 * kVoxel, traced);
    const Cut truth = Excavator(bucket).sweep(*exact, traced);
    const ToolCut cut = subtract(*by_shape, tool, path);
    EXPECT_GT(truth.all.sum(), 100'000);
    EXPECT_NEAR(static_cast<double>(cut.samples) / static_cast<double>(truth.all.sum()), 1, 1e-3);
    EXPECT_EQ(volume_m3(*by_shape, cut), -by_shape->change_m3());
    EXPECT_EQ(subtract(*by_shape, tool, path).samples, 0) << "the same path again takes nothing";
  }
}

TEST(ToolCut, OfABallIsItsVolumeWhereverItIs) {
  constexpr double kRadius = 0.4;
  const ToolShape ball = make_tool_shape(
      *level_set_sphere(static_cast<float>(kRadius), {0, 0, 0}, static_cast<float>(kVoxel / 4)));
  const double volume = 4 * kPi / 3 * kRadius * kRadius * kRadius;
  for (const Vec3& at : {Vec3(0, 0, -1), Vec3(0.013, -0.021, -2.037)}) {
    const auto ground = flat();
    const Pose pose{near(*ground, at.x(), at.y(), at.z()), from_rpy(0.3, 0.2, 0.1)};
    EXPECT_NEAR(volume_m3(*ground, subtract(*ground, ball, {&pose, 1})), volume, 2e-3 * volume);
  }
  // Along a straight way: a cylinder more.
  const auto ground = flat();
  const std::vector<Pose> way = {{near(*ground, 0, 0, -1), from_rpy(0, 0, 0)},
                                 {near(*ground, 1.5, 0.5, -1.3), from_rpy(1, 1, 1)}};
  const double swept = volume + kPi * kRadius * kRadius * Vec3(1.5, 0.5, -0.3).norm();
  EXPECT_NEAR(volume_m3(*ground, subtract(*ground, ball, way)), swept, 2e-3 * swept);
}

TEST(ToolCut, OfADrillIsItsHoleHoweverOftenItTurns) {
  constexpr double kRadius = 0.3, kDepth = 1;
  const ToolShape drill(cylinder(kRadius, 0, 2), 0.02);
  const double area = 32 * kRadius * kRadius * std::sin(2 * kPi / 64);  // of the polygon
  std::vector<double> volumes;
  for (const int turns : {0, 7}) {
    const auto ground = flat();
    std::vector<Pose> way;
    for (int i = 0; i <= 40; ++i)
      way.push_back({near(*ground, 0, 0, 0.5 - (0.5 + kDepth) * i / 40.0),
                     from_rpy(0, 0, 2 * kPi * turns * i / 40.0)});
    volumes.push_back(volume_m3(*ground, subtract(*ground, drill, way)));
  }
  EXPECT_NEAR(volumes[0], area * kDepth, 2e-3 * area);
  EXPECT_NEAR(volumes[1], kPi * kRadius * kRadius * kDepth, 4e-3 * area) << "round, as it turns";
}

TEST(ToolCut, IsTheSameForAnyThreadsAndHoweverItsWayIsSplit) {
  const ToolShape tool(box({-0.5, -0.2, -0.1}, {0.1, 0.9, 0.4}), 0.03);
  std::vector<std::uint64_t> hashes;
  for (const int threads : {1, 2}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    for (const std::size_t split : {0U, 3U}) {
      const auto ground = flat();
      std::vector<Pose> way;
      for (int i = 0; i <= 6; ++i)
        way.push_back(
            {near(*ground, 0.3 * i, 0.1 * i, 0.2 - 0.1 * i), from_rpy(0, 0.2 * i, 0.5 * i)});
      const std::span<const Pose> all = way;
      if (split > 0) subtract(*ground, tool, all.first(split + 1));
      subtract(*ground, tool, all.subspan(split));
      hashes.push_back(ground->state_hash());
    }
  }
  for (const std::uint64_t hash : hashes) EXPECT_EQ(hash, hashes[0]);
}

TEST(ToolCut, CountsWhatWasLoose) {
  const auto ground = flat();
  SampleWords words;
  words.fill(kAllSoil);
  GroundWriter(*ground).add({0, 0, 8}, words, GroundWriter::Kind::kLoose);
  const ToolShape tool(box({-1, -1, -1}, {1, 1, 2}), 0.05);
  const Pose pose{ground->origin(), from_rpy(0, 0, 0)};
  const ToolCut cut = subtract(*ground, tool, {&pose, 1});
  EXPECT_EQ(cut.loose, 64 * kChunkVoxels);
  EXPECT_GT(cut.samples, cut.loose);
}

TEST(ToolUnite, AddsWhatIsBuilt) {
  const auto ground = flat();
  const ToolShape wall(box({-1, -0.1, -0.5}, {1, 0.1, 1}), 0.025);
  const Pose pose{near(*ground, 0, 0, 0), from_rpy(0, 0, 0.7)};
  const std::int64_t added = unite(*ground, wall, pose);
  EXPECT_NEAR(static_cast<double>(added) * ground->sample_m3(), 2 * 0.2 * 1, 2e-3);
  EXPECT_EQ(unite(*ground, wall, pose), 0);
  EXPECT_NEAR(volume_m3(*ground, subtract(*ground, wall, {&pose, 1})), 2 * 0.2 * 1.5, 2e-3);
}

TEST(ToolShape, RefusesWhatIsNoBody) {
  Mesh open = box({0, 0, 0}, {1, 1, 1});
  open.triangles.pop_back();
  EXPECT_THAT([&] { ToolShape(open, 0.1); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("isn't closed")));
  EXPECT_THAT(
      [&] {
        ToolShape(box({0, 0, 0}, {1, 1, 1}), 1e-5);
      },
      ThrowsMessage<std::invalid_argument>(HasSubstr("too large for voxels of 1e-05 m")));
  EXPECT_THAT(
      [&] {
        ToolShape(box({0, 0, 0}, {1, 1, 1}), 0);
      },
      ThrowsMessage<std::invalid_argument>(HasSubstr("larger than 0 m")));
  EXPECT_THAT([&] { ToolShape(Mesh{}, 0.1); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("isn't closed")));
  Mesh cube = box({0, 0, 0}, {1, 1, 1});
  EXPECT_EQ(lost_by(ToolShape(cube, 0.02), cube), "");
  EXPECT_NEAR(ToolShape(cube, 0.02).volume_m3(), 1, 1e-3);
  EXPECT_THAT(lost_by(ToolShape(cube, 0.4), cube), HasSubstr("m3 and its mesh 1 m3"));
  cube.points[3].y() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT([&] { ToolShape(cube, 0.1); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("a point that is not a number")));
  EXPECT_THAT(
      [&] {
        ToolShape(box({1e8, 0, 0}, {1e8 + 8, 1, 1}), 0.1);
      },
      ThrowsMessage<std::invalid_argument>(HasSubstr("m from its own origin")));
  const auto fog = level_set_sphere(1, {0, 0, 0}, 0.1F);
  fog->setGridClass(openvdb::GRID_FOG_VOLUME);
  EXPECT_THAT([&] { make_tool_shape(*fog); },
              ThrowsMessage<std::invalid_argument>(HasSubstr("must be a level set")));
}

}  // namespace tool_cut_test
}  // namespace soilvdb::test
