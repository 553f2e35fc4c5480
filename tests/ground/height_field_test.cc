// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A height field against its posts, asked point by point, where patches, tiles, holes and edges
// meet.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "core/ground/ray_terrain.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/initial_terrain.h"

namespace soilvdb::test {
namespace height_field_test {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kVoxel = 0.0625;    // four to a patch along x, not a whole number along y
constexpr int kNx = 130, kNy = 131;  // two posts and three more than whole tiles of 64

class Posts final : public HeightSource {
 public:
  const HeightGrid grid{kNx, kNy, {10.5, -3.25}, {0.25, 0.4}};
  std::vector<float> z = std::vector<float>(std::size_t{kNx} * kNy);

  float& at(int x, int y) { return z[static_cast<std::size_t>(y * kNx + x)]; }
  double post(int x, int y) const { return z[static_cast<std::size_t>(y * kNx + x)]; }
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int y = y0; y < y0 + ny; ++y)
      for (int x = x0; x < x0 + nx; ++x) *out++ = static_cast<float>(post(x, y));
  }
  Vec2 place(double x, double y) const {
    return grid.first + Vec2(x, y).cwiseProduct(grid.spacing);
  }
  /// A point of patch (i, j), (u, v) from 0 to 1.
  Vec3 point(int i, int j, double u, double v) const {
    const double low = (1 - u) * post(i, j) + u * post(i + 1, j);
    const double high = (1 - u) * post(i, j + 1) + u * post(i + 1, j + 1);
    const Vec2 xy = place(i + u, j + v);
    return {xy.x(), xy.y(), (1 - v) * low + v * high};
  }
  double height(double x, double y) const {
    const Vec2 p = (Vec2(x, y) - grid.first).cwiseQuotient(grid.spacing);
    if (!(p.minCoeff() >= 0 && p.x() <= kNx - 1 && p.y() <= kNy - 1)) return kNone;
    const int i = std::min(static_cast<int>(p.x()), kNx - 2);
    const int j = std::min(static_cast<int>(p.y()), kNy - 2);
    return point(i, j, p.x() - i, p.y() - j).z();
  }
};

/// Heights at random, binary fractions, with a hole beside the corner of four tiles.
std::shared_ptr<Posts> posts(double roughness_m) {
  auto posts = std::make_shared<Posts>();
  std::mt19937 random(5);
  for (int y = 0; y < kNy; ++y) {
    for (int x = 0; x < kNx; ++x)
      posts->at(x, y) =
          static_cast<float>((static_cast<double>(random() % 256) / 256 - 0.5) * roughness_m +
                             0.25 * std::sin(0.3 * x + 0.2 * y));
  }
  posts->at(66, 63) = std::numeric_limits<float>::quiet_NaN();
  return posts;
}

std::unique_ptr<InitialTerrain> field(const std::shared_ptr<Posts>& posts) {
  return make_height_field(posts->grid, posts);
}

/// Posts at which something begins or ends: the grid, a patch, a tile, a hole.
constexpr int kBordersX[] = {0, 20, 63, 64, 66, 128, kNx - 1};
constexpr int kBordersY[] = {0, 41, 63, 64, 128, kNy - 1};

/// Calls `f(first)` with the first voxels of chunks about the borders, whose cells end on them or
/// lie across, that hold the ground's surface.
template <typename F>
void for_chunks_on_borders(const Posts& posts, F f, double voxel = kVoxel) {
  std::mt19937 random(2);
  for (const int x : kBordersX) {
    for (const int y : kBordersY) {
      const Vec2 corner = posts.place(x, y);
      const Vec2 cells(static_cast<double>(random() % 9), static_cast<double>(random() % 9));
      const Vec2 ends = corner - voxel * (cells - Vec2(0.5, 0.5));
      const double z = std::isnan(posts.post(x, y)) ? 0 : posts.post(x, y);
      f(Vec3(ends.x(), ends.y(), z - voxel * 2));
      f(Vec3(ends.x() - 0.4 * voxel, ends.y() + 0.3 * voxel, z - voxel * 6));
    }
  }
}

TEST(HeightField, HasEachPostsHeightAndTheMeanBetweenTwo) {
  const auto posts = height_field_test::posts(0.5);
  const auto terrain = field(posts);
  for (int y = 0; y < kNy; ++y) {
    for (int x = 0; x < kNx; ++x) {
      if (std::abs(x - 66) <= 1 && std::abs(y - 63) <= 1) continue;  // of a patch without a height
      const Vec2 p = posts->place(x, y), beside = posts->place(x + 0.5, y);
      // Along y places are rounded.
      EXPECT_NEAR(terrain->height(p.x(), p.y()).value_or(kNone), posts->post(x, y), 1e-12);
      if (x + 1 == kNx || std::abs(x - 65.5) <= 2) continue;
      EXPECT_NEAR(terrain->height(beside.x(), beside.y()).value_or(kNone),
                  (posts->post(x, y) + posts->post(x + 1, y)) / 2, 1e-12);
    }
  }
  const Vec2 end = posts->place(kNx - 1, kNy - 1), first = posts->grid.first;
  EXPECT_FALSE(terrain->height(end.x() + 1e-9, first.y()));
  EXPECT_FALSE(terrain->height(first.x(), end.y() + 1e-9));
  EXPECT_FALSE(terrain->height(first.x() - 1e-9, first.y()));
  EXPECT_FALSE(terrain->height(first.x(), first.y() - 1e-9));
  const Vec2 hole = posts->place(65.5, 63.5);
  EXPECT_FALSE(terrain->height(hole.x(), hole.y()));
}

TEST(HeightField, SamplesAreSoilBelowTheHeightAndNowhereElse) {
  constexpr double kTie = 1e-4;  // voxels: a cell's heights are floats of some voxels
  const auto posts = height_field_test::posts(0.5);
  const auto terrain = field(posts);
  for (const double voxel : {kVoxel, 0.3, 0.7}) {  // cells within patches, and over up to 4 x 3
    std::int64_t soil = 0, air = 0, ties = 0;
    Coord3 chunk(0, 0, 0);
    for_chunks_on_borders(
        *posts,
        [&](const Vec3& first) {
          chunk += Coord3(8, 16, 8);
          SampleWords words;
          terrain->samples(chunk, first, voxel, words);
          std::int64_t wrong = 0;
          for (int n = 0; n < kChunkVoxels; ++n) {
            const Coord3 cell = numbered_voxel(n);
            const CellPoints& points = sample_points(chunk + cell);
            for (int i = 0; i < 64; ++i) {
              const Vec3 in_cell(points.x[i], points.y[i], points.z[i]);
              const Vec3 p = first + voxel * (cell.cast<double>() - Vec3::Constant(0.5) + in_cell);
              const double above = p.z() - posts->height(p.x(), p.y());
              if (std::abs(above) < kTie * voxel) {
                ++ties;
                continue;
              }
              ++(above < 0 ? soil : air);
              wrong += (above < 0) != ((words[static_cast<std::size_t>(n)] >> i & 1) != 0);
            }
          }
          EXPECT_EQ(wrong, 0) << "from " << first.transpose();
        },
        voxel);
    EXPECT_GT(soil, air / 4);
    EXPECT_GT(air, soil / 4);
    EXPECT_LT(ties, (soil + air) / 1000);
  }
}

/// Distance to a patch: the nearest of a grid of points on it, and of finer ones about that.
double distance_to(const Posts& posts, int i, int j, const Vec3& p) {
  double u = 0.5, v = 0.5, reach = 0.5, least = 1e9;
  for (int level = 0; level < 14; ++level, reach *= 0.5) {
    const double u0 = u, v0 = v;
    for (int k = 0; k < 25; ++k) {
      const double a = std::clamp(u0 + reach * (k % 5 - 2) / 2, 0.0, 1.0);
      const double b = std::clamp(v0 + reach * (k / 5 - 2) / 2, 0.0, 1.0);
      const double d = (posts.point(i, j, a, b) - p).norm();
      if (!(d < least)) continue;
      least = d, u = a, v = b;
    }
  }
  return least;
}

TEST(HeightField, DistanceIsThatToTheNearestPatchOnBothSidesOfABorder) {
  // Three steps of Gauss-Newton, of which a border takes one, each by 0.02 or smaller, from an
  // error of the band at most: three voxels.
  constexpr double kError = 3 * 0.02 * 0.02;
  constexpr double kBand = 3 * kVoxel;
  const auto posts = height_field_test::posts(0.04);
  const auto terrain = field(posts);
  int looked = 0;
  for_chunks_on_borders(*posts, [&](const Vec3& first) {
    float phi[kChunkVoxels];
    terrain->distance(first, kVoxel, kBand, phi);
    for (int n = 0; n < kChunkVoxels; n += 3) {
      const Vec3 p = first + kVoxel * numbered_voxel(n).cast<double>();
      const Vec2 at = (p.head<2>() - posts->grid.first).cwiseQuotient(posts->grid.spacing);
      const int x = static_cast<int>(std::floor(at.x())), y = static_cast<int>(std::floor(at.y()));
      double distance = kBand;
      for (int j = std::max(0, y - 1); j <= std::min(kNy - 2, y + 1); ++j) {
        for (int i = std::max(0, x - 1); i <= std::min(kNx - 2, x + 1); ++i)
          distance = std::min(distance, distance_to(*posts, i, j, p));
      }
      looked += distance < kBand;
      if (p.z() < posts->height(p.x(), p.y())) distance = -distance;
      ASSERT_NEAR(phi[n], distance, kError * kVoxel) << p.transpose();
    }
  });
  EXPECT_GT(looked, 1000);
}

TEST(HeightField, ABoxIsCalledAirOrSoilWhereAllItsPointsAre) {
  const auto posts = height_field_test::posts(0.5);
  const auto terrain = field(posts);
  std::mt19937 random(9);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution(low, high)(random);
  };
  int air = 0, soil = 0;
  for (int k = 0; k < 20'000; ++k) {
    // Half of them end on a border.
    const int x = kBordersX[random() % std::size(kBordersX)],
              y = kBordersY[random() % std::size(kBordersY)];
    const Vec2 low =
        posts->place(x - (k % 2 ? 0 : between(0, 2)), y - (k % 4 < 2 ? 0 : between(0, 2)));
    const Vec2 high = posts->place(x + (k % 8 < 4 ? 0 : between(0, 2)), y + between(0, 2));
    const double z = between(-1, 1);
    const Eigen::AlignedBox3d box(Vec3(low.x(), low.y(), z),
                                  Vec3(high.x(), high.y(), z + between(0, 0.2)));
    const Content content = terrain->classify(box);
    if (content == Content::kMixed) continue;
    ++(content == Content::kAir ? air : soil);
    for (int i = 0; i < 81; ++i) {
      const Vec2 p = low + (high - low).cwiseProduct(Vec2(i / 9, i % 9)) / 8;
      const double height = posts->height(p.x(), p.y());
      if (content == Content::kAir) {
        ASSERT_FALSE(height > box.min().z() + 1e-9) << p.transpose();
      } else {
        ASSERT_TRUE(height > box.max().z() - 1e-9) << p.transpose();
        ASSERT_TRUE(terrain->has_data(box));
      }
    }
  }
  EXPECT_GT(air, 1000);
  EXPECT_GT(soil, 1000);
}

/// Large boxes are looked at by tiles.
TEST(HeightField, ABoxOfAnySizeIsSoilUnlessItReachesAHole) {
  const auto posts = height_field_test::posts(0.5);
  const auto terrain = field(posts);
  for (const int side : {1, 10, 30, 40, 60}) {
    const auto box_from = [&](int x, int y) {
      const Vec2 low = posts->place(x + 0.1, y + 0.1), high = posts->place(x + side, y + side);
      return Eigen::AlignedBox3d(Vec3(low.x(), low.y(), -9), Vec3(high.x(), high.y(), -5));
    };
    const auto sound = box_from(2, 66), holed = box_from(65 - side / 10, 63 - 3 * side / 4);
    EXPECT_EQ(terrain->classify(sound), Content::kSoil) << side;
    EXPECT_TRUE(terrain->has_data(sound)) << side;
    EXPECT_EQ(terrain->classify(holed), Content::kMixed) << side;
    EXPECT_FALSE(terrain->has_data(holed)) << side;
  }
}

TEST(HeightField, AtAHoleABoxIsKnownOnlyAboveAllGroundAroundIt) {
  const auto posts = height_field_test::posts(0.5);
  const auto terrain = field(posts);
  std::mt19937 random(10);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution(low, high)(random);
  };
  int known = 0, unknown = 0;
  for (int k = 0; k < 5'000; ++k) {
    // Some of its patches have the hole, at (66, 63), as a corner.
    const Vec2 low(between(64.2, 66.9), between(61.2, 63.9)), high = low + Vec2(0.9, 0.9);
    const double z = between(-1, 1);
    double highest = -9.0;
    for (int y = static_cast<int>(low.y()); y <= static_cast<int>(high.y()) + 1; ++y) {
      for (int x = static_cast<int>(low.x()); x <= static_cast<int>(high.x()) + 1; ++x)
        if (x != 66 || y != 63) highest = std::max(highest, posts->post(x, y));
    }
    const Vec2 a = posts->place(low.x(), low.y()), b = posts->place(high.x(), high.y());
    const bool is_known = terrain->has_data({Vec3(a.x(), a.y(), z), Vec3(b.x(), b.y(), 9.0)});
    ++(is_known ? known : unknown);
    EXPECT_EQ(is_known, z >= highest) << low.transpose();
  }
  EXPECT_GT(known, 1000);
  EXPECT_GT(unknown, 1000);
}

TEST(HeightField, WhatIsForgottenTakesNoMemoryAndIsReadAgain) {
  const auto posts = height_field_test::posts(0.5);
  const auto terrain = field(posts);
  const auto& rays = dynamic_cast<const RayTerrain&>(*terrain);
  const std::uint64_t none = terrain->memory_bytes();
  const Vec2 end = posts->place(kNx - 1, kNy - 1);
  const Vec3 origin(posts->grid.first.x(), posts->grid.first.y(), 3);
  const Vec3 direction = Vec3(end.x() - origin.x(), end.y() - origin.y(), -3.3).normalized();
  const auto look = [&] {
    const double met = rays.meet(origin, direction, 0);
    return std::pair(terrain->height(end.x(), end.y()).value(), met);
  };
  const auto first = look();
  const std::uint64_t read = terrain->memory_bytes();
  EXPECT_GE(read - none, std::uint64_t{kNx} * sizeof(float));
  terrain->forget();
  EXPECT_LE(terrain->memory_bytes(), none);
  EXPECT_EQ(look(), first);
  EXPECT_EQ(terrain->memory_bytes(), read);
}

}  // namespace height_field_test
}  // namespace soilvdb::test
