// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights from samples: their sums are the ledger's volumes, their surface is that which was cut.
#include "soilvdb/height_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <tuple>
#include <vector>

#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/height_reader.h"
#include "soilvdb/ground_grids.h"
#include "tests/support/allocations.h"
#include "tests/support/earthmoving_fixture.h"
#include "tests/support/sanitized.h"
#include "tests/support/spheres.h"

namespace soilvdb::test {
namespace height_map_test {

std::vector<double> map_of(HeightMap& heights, const MapGrid& grid, MapLayer layer,
                           std::optional<double> ceiling_m = {}) {
  std::vector<double> out(static_cast<std::size_t>(grid.nx * grid.ny), -1);
  heights.map(grid, layer, std::span<double>(out), ceiling_m).check();
  return out;
}

double sum_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum;
}

/// A random stroke without a roof over it: down, along, and up.
std::vector<Pose> random_way(std::mt19937_64& random) {
  std::uniform_real_distribution<double> place(-1.5, 1.5), deep(0.1, 0.5), turn(-3, 3);
  const double yaw = turn(random);
  const Vec3 ahead(std::cos(yaw), std::sin(yaw), 0), up = Vec3::UnitZ();
  const Vec3 begin(place(random), place(random), -deep(random)), end = begin + 1.5 * ahead;
  std::vector<Pose> way;
  for (const Vec3& at :
       {Vec3(begin + 1.2 * up), begin, Vec3((begin + end) / 2), end, Vec3(end + 1.2 * up)})
    way.push_back({at, from_rpy(0, 0, yaw)});
  return way;
}

/// Covers the site, with cells of any size and place.
MapGrid over_site(double cell_m, const Vec2& first_m) {
  const int n = static_cast<int>(std::ceil(24 / cell_m));
  return {first_m - Vec2::Constant(12), cell_m, n, n};
}

TEST(HeightMap, SumsOverCellsAreTheVolumesOfTheLedger) {
  constexpr double h = 0.1;
  std::mt19937_64 random(1);
  for (int scene = 0; scene < (kLong ? 20 : 4); ++scene) {
    const bool moves = scene % 2 == 1;
    Ground ground(h, Vec3(300000, 5000000, 20),
                  make_plane(20.013 - 0.02 * 300000 + 0.03 * 5000000, {0.02, -0.03}));
    Tracker tracker(ground, {digger()}, moves ? loam() : Earthmoving());
    HeightMap heights(ground);
    for (Pose pose : random_way(random)) {
      pose.position += Vec3(300000, 5000000, 20);
      tracker.update(0, pose);
      const Vec2 first = Vec2(300000, 5000000) + Vec2(0.013 * scene, 0.029);
      for (const double cell_m : {h, 2 * h, 0.25, 0.07}) {
        const MapGrid grid = over_site(cell_m, first);
        const double dug_m3 = sum_of(map_of(heights, grid, MapLayer::kDug)) * cell_m * cell_m;
        EXPECT_NEAR(dug_m3, -ground.change_m3(), 1e-7 * (1 + std::abs(dug_m3)))
            << scene << ", " << cell_m;
      }
      // Where cells are the voxels', to the last sample.
      const MapGrid grid = over_site(h, Vec2(300000, 5000000));
      const double samples = 64 * sum_of(map_of(heights, grid, MapLayer::kDug)) / h;
      EXPECT_EQ(std::llround(samples), -std::llround(ground.change_m3() / ground.sample_m3()));
      EXPECT_NEAR(samples, std::round(samples), 1e-4);
    }
  }
}

TEST(HeightMap, KeepsNothingThatIsNoLongerSo) {
  std::mt19937_64 random(2);
  Ground ground(0.1, Vec3(0, 0, 0), make_plane(0, {0.1, 0.05}));
  Tracker tracker(ground, {digger()}, loam());
  HeightMap kept(ground);
  std::vector<Vec2> places;
  std::uniform_real_distribution<double> place(-5, 5);
  for (int i = 0; i < 300; ++i) places.emplace_back(place(random), place(random));
  for (int n = 0; n < 3; ++n) {
    for (const Pose& pose : random_way(random)) {
      tracker.update(0, pose);
      HeightMap fresh(ground);
      const MapGrid grid = MapGrid::around({0.3, -0.2}, 0.1, 90, 70, n == 2 ? &pose : nullptr);
      for (const MapLayer layer : {MapLayer::kHeight, MapLayer::kLoose, MapLayer::kDug})
        ASSERT_EQ(map_of(kept, grid, layer), map_of(fresh, grid, layer));
      std::vector<double> a(places.size()), b(places.size());
      kept.at(places, a).check();
      fresh.at(places, b).check();
      ASSERT_EQ(a, b);
      for (const auto& [heights, out] : {std::pair(&kept, &a), {&fresh, &b}})
        heights->lines({-3, -2}, {0.3, 0.05}, 20, {-0.03, 0.25}, 15, *out);
      ASSERT_EQ(a, b);
    }
  }
  const std::unique_ptr<Ground> clone = ground.clone();
  HeightMap of_clone(*clone, kept);
  const MapGrid grid = over_site(0.1, {0, 0});
  EXPECT_EQ(map_of(kept, grid, MapLayer::kHeight), map_of(of_clone, grid, MapLayer::kHeight));
}

/// Of a ground whose columns are elsewhere, or of other voxels.
TEST(HeightMap, OthersTellNothingThatIsNotSo) {
  const std::shared_ptr<const InitialTerrain> terrain = make_plane(1, {0.4, -0.3});
  Ground first(0.1, Vec3(0, 0, 0), terrain);
  HeightMap of_first(first);
  const MapGrid grid = over_site(0.25, {0.03, 0.02});
  map_of(of_first, grid, MapLayer::kHeight);
  for (const double h : {0.1, 0.2}) {
    for (const Vec3& origin : {Vec3(0, 0, 0), Vec3(0.33, 0.14, 0), Vec3(0, 0, -3)}) {
      Ground ground(h, origin, terrain);
      Tracker tracker(ground, {digger()});
      std::mt19937_64 random(17);
      for (const Pose& pose : random_way(random)) tracker.update(0, pose);
      HeightMap told(ground, of_first), fresh(ground);
      for (const MapLayer layer : {MapLayer::kHeight, MapLayer::kDug})
        EXPECT_EQ(map_of(told, grid, layer), map_of(fresh, grid, layer)) << origin.transpose();
    }
  }
}

/// Whoever looks first, and at whatever else.
TEST(HeightMap, OnePlaceIsAsAmongMany) {
  std::mt19937_64 random(3);
  const HeightGrid posts{401, 401, {-20, -20}, {0.1, 0.1}};
  for (const auto& terrain : {std::shared_ptr<const InitialTerrain>(make_plane(0, {0.1, 0.05})),
                              raster(posts, [](double x, double y) {
                                return 0.1 * x + 0.4 * std::sin(3 * x) * std::cos(2 * y) +
                                       0.1 * std::sin(23 * x + 31 * y);
                              })}) {
    Ground ground(0.1, Vec3(0, 0, 0), terrain);
    Tracker tracker(ground, {digger()});
    for (const Pose& pose : random_way(random)) tracker.update(0, pose);
    const double deep = 13;  // more chunks than are looked at below the terrain
    for (const Vec3& place : {Vec3(0.5, 0.5, 2), Vec3(0.5, 0.5, -deep), Vec3(0.6, 0.5, -deep),
                              Vec3(0.5, 0.5, -deep), Vec3(0.5, 0.5, 2)})
      tracker.update(0, {place, Eigen::Quaterniond::Identity()});
    std::vector<Vec2> near, far;
    std::uniform_real_distribution<double> place(-3, 3);
    for (int i = 0; i < 200; ++i) near.emplace_back(place(random), place(random));
    for (double x = 0; x < 1.5; x += 0.05) near.emplace_back(x, 0.5);
    far = near;
    far.emplace_back(4000, -3000);  // too far apart to be read at once
    std::vector<double> a(near.size()), b(far.size());
    HeightMap(ground).at(near, a).check();
    HeightMap(ground).at(far, b).check();
    EXPECT_LT(*std::min_element(a.begin(), a.end()), -deep / 2);
    for (std::size_t i = 0; i < near.size(); ++i) {
      double alone;
      HeightMap(ground).at({&near[i], 1}, {&alone, 1}).check();
      ASSERT_EQ(alone, a[i]);
      ASSERT_EQ(alone, b[i]);
    }
    const double beyond = terrain->height(4000, -3000).value_or(HeightReader::kNoGround);
    EXPECT_TRUE(std::isnan(beyond) ? std::isnan(b.back()) : std::abs(b.back() - beyond) < 1e-9);
  }
}

/// Of many places only those near changed ground are read.
TEST(HeightMap, ManyPlacesAreAsFew) {
  std::mt19937_64 random(14);
  const HeightGrid posts{401, 401, {-20, -20}, {0.1, 0.1}};
  for (const auto& terrain : {std::shared_ptr<const InitialTerrain>(make_plane(0, {0.1, 0.05})),
                              raster(posts, [](double x, double y) {
                                return std::hypot(x - 3, y - 2) < 0.6 ? HeightReader::kNoGround
                                                                      : 0.4 * std::sin(3 * x + y);
                              })}) {
    Ground ground(0.1, Vec3(0, 0, 0), terrain);
    HeightMap kept(ground);
    std::vector<Vec2> places;
    std::uniform_real_distribution<double> wide(-25, 25), near(-3, 3);
    for (int i = 0; i < 5000; ++i) {
      auto& place = i % 3 == 0 ? wide : near;
      places.emplace_back(place(random), place(random));
    }
    for (int i = 0; i < 400; ++i)  // columns' middles and borders, and so tiles' borders
      places.emplace_back(0.05 * (i % 20) - 0.5, 0.05 * (i / 20) - 0.5);
    places[7] = {HeightReader::kNoGround, 0};
    places[8] = {1e12, 0};
    for (const Vec3& move : {Vec3(0, 0, 0), Vec3(1, 0.5, 0), Vec3(12, 7, 0)}) {
      for (const std::optional<double> ceiling : {std::optional<double>(), {0.05}}) {
        std::vector<double> all(places.size()), few(1000);
        kept.at(places, all, ceiling).check();
        for (std::size_t first = 0; first < places.size(); first += few.size()) {
          const std::size_t count = std::min(few.size(), places.size() - first);
          const std::span<const Vec2> some = std::span(places).subspan(first, count);
          HeightMap(ground).at(some, std::span(few).first(count), ceiling).check();
          for (std::size_t i = 0; i < count; ++i)
            ASSERT_TRUE(all[first + i] == few[i] ||
                        (std::isnan(all[first + i]) && std::isnan(few[i])))
                << some[i].transpose() << ": " << all[first + i] << ", " << few[i];
        }
      }
      Tracker tracker(ground, {digger()});
      for (Pose pose : random_way(random)) {
        pose.position += move;
        try {
          tracker.update(0, pose);
        } catch (const NoGroundError&) {  // it may come to the hole
        }
      }
    }
  }
}

TEST(HeightMap, LinesEndWithTheTerrain) {
  const HeightGrid posts{41, 41, {-2.02, -2.02}, {0.1, 0.1}};
  Ground ground(0.1, Vec3(0, 0, 0), raster(posts, [](double x, double y) { return x + 2 * y; }));
  Tracker tracker(ground, {digger()});
  for (const double z : {5.0, 1.0, 5.0})
    tracker.update(0, {Vec3(0.9, 0.9, z), Eigen::Quaterniond::Identity()});
  HeightMap heights(ground);
  for (const Vec2& along : {Vec2(0.03, 0), Vec2(0.02, 0.02), Vec2(0, -0.03)}) {
    std::vector<double> lines(2 * 200), alone(1);
    const Vec2 first = -100 * along, across(0.05, -0.3);
    heights.lines(first, along, 200, across, 2, lines);
    std::size_t ends = 0;
    for (int k = 0; k < 2; ++k) {
      for (int i = 0; i < 200; ++i) {
        const Vec2 at = first + i * along + k * across;
        heights.at({&at, 1}, alone).check();
        const double z = lines[static_cast<std::size_t>(200 * k + i)];
        const bool inside = (at - posts.first).minCoeff() > 0.15 && (at.array() < 1.85).all();
        // Near the end fewer columns tell the height.
        if (inside) {
          EXPECT_NEAR(z, alone[0], 0.03) << at.transpose();
        }
        // The last column with ground is the nearest.
        const bool last = at.maxCoeff() > 1.91 && at.maxCoeff() < 1.94 && at.minCoeff() > -1.8;
        if (last) {
          EXPECT_FALSE(std::isnan(z)) << at.transpose();
        }
        ends += last;
      }
    }
    EXPECT_GT(ends, 0u);
  }
}

TEST(HeightMap, UntouchedGroundIsTheTerrainAndCutsAreWhereTheyWereMade) {
  constexpr double h = 0.05;
  const Vec3 origin(500000, 5400000, 100);
  const auto rises = [&](double z, const Vec2& slope) {
    return [=](const Vec2& at) { return z + slope.dot(at - origin.head<2>()); };
  };
  const auto before = rises(100.313, {0.02, -0.03}), cut = rises(99.9, {0.08, 0});
  Ground ground(h, origin, make_plane(before({0, 0}), {0.02, -0.03}));
  HeightMap heights(ground);
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> place(-2, 2);
  const auto errors = [&](const auto& wanted) {
    std::vector<double> all;
    for (int i = 0; i < 400; ++i) {
      const Vec2 at(origin.x() + place(random), origin.y() + 0.5 * place(random));
      double z;
      heights.at({&at, 1}, {&z, 1}).check();
      all.push_back(std::abs(z - wanted(at)));
    }
    std::sort(all.begin(), all.end());
    return all;
  };
  EXPECT_LT(errors(before).back(), 1e-8);
  Tracker tracker(ground, {Bucket{3, 2, {}, {}}});
  for (const double x : {-3.0, 3.0}) {
    const Vec2 lip(origin.x() + x, origin.y());
    tracker.update(0, {{lip.x(), lip.y(), cut(lip)}, {1, 0, 0, 0}});
  }
  const std::vector<double> off = errors(cut);
  double sum2 = 0;
  for (const double e : off) sum2 += e * e;
  EXPECT_LT(std::sqrt(sum2 / 400), 0.03 * h) << "what counts err by";
  EXPECT_LT(off.back(), 0.1 * h);
}

TEST(HeightMap, TurnsWithTheLip) {
  constexpr double h = 0.1;
  const auto slope = [](const Vec2& at) { return 0.2 * at.x() - 0.3 * at.y(); };
  Ground ground(h, Vec3(0, 0, 0), make_plane(0, {0.2, -0.3}));
  HeightMap heights(ground);
  for (const double yaw : {0.0, 0.4, 1.5, 3.0, -2.0}) {
    for (const double pitch : {-2.5, -1.0, 0.0, 1.0}) {  // the mouth looks back as well
      const Pose pose{{1.3, -0.7, 0}, from_rpy(0, pitch, yaw)};
      for (const double cell_m : {0.05, 0.1, 0.23}) {
        const MapGrid grid = MapGrid::around(pose.position.head<2>(), cell_m, 7, 5, &pose);
        const Vec2 ahead(std::cos(yaw), std::sin(yaw)), left(-ahead.y(), ahead.x());
        const std::vector<double> map = map_of(heights, grid, MapLayer::kHeight);
        for (int i = 0; i < 5; ++i) {
          for (int j = 0; j < 7; ++j) {
            const Vec2 at = pose.position.head<2>() + cell_m * ((j - 3) * ahead + (i - 2) * left);
            EXPECT_LT((grid.middle_m(i, j) - at).norm(), 1e-9);
            // Means by counts; with the world's axes of whole columns.
            EXPECT_NEAR(map[static_cast<std::size_t>(7 * i + j)], slope(at), 0.2 * h);
          }
        }
      }
    }
  }
}

TEST(HeightMap, TurnsWithTheMouthWhereTheLipStandsUpright) {
  for (const double yaw : {0.0, 0.4, 3.0, -2.0}) {
    for (const double roll : {-std::numbers::pi / 2, -1.2, 0.9, std::numbers::pi / 2}) {
      const Pose pose{{0, 0, 0}, from_rpy(roll, 0, yaw)};
      const MapGrid grid = MapGrid::around({1, 2}, 0.1, 7, 5, &pose);
      EXPECT_LT((grid.along - Vec2(std::cos(yaw), std::sin(yaw))).norm(), 1e-9)
          << yaw << ", " << roll;
    }
  }
}

/// Its points are a voxel apart or closer, so none of them is farther than 0.71 voxels away.
TEST(HeightMap, ATurnedCellShowsEachColumnWhoseMiddleItHolds) {
  constexpr double h = 0.1;
  Ground ground(h, Vec3(0, 0, 0), make_plane(0, {0, 0}));
  SampleWords deep{};
  for (int z = 0; z < kChunkSide; ++z)
    deep[static_cast<std::size_t>(cell_number({3, 5, z}))] = kAllSoil;
  GroundWriter(ground).remove({0, 0, -8}, deep);
  HeightMap heights(ground);
  const Vec2 column(3 * h, 5 * h);
  for (const double yaw : {0.3, 0.785, 2.0}) {
    const Pose pose{{0, 0, 0}, from_rpy(0, 0, yaw)};
    for (const double side : {0.9, 1.2, 1.45, 1.9, 2.4}) {
      for (const double u : {-0.49, -0.2, 0.3, 0.49}) {
        for (const double v : {-0.49, 0.1, 0.49}) {
          MapGrid grid = MapGrid::around(column, side * h, 1, 1, &pose);
          const Vec2 left(-grid.along.y(), grid.along.x());
          grid.first_m += side * h * (u * grid.along + v * left);
          EXPECT_GT(map_of(heights, grid, MapLayer::kDug)[0], 0.01 * h)
              << yaw << ", " << side << ", " << u << ", " << v;
        }
      }
    }
  }
}

/// A cave below a plane, a trench beside, and ground that is as it was.
struct Cave : Ground {
  Cave() : Ground(0.1, Vec3(0, 0, 0), make_plane(2, {0, 0})) {
    SampleWords all;
    all.fill(kAllSoil);
    for (const int y : {-8, 0})
      for (const int x : {-8, 0, 8}) GroundWriter(*this).remove({x, y, 0}, all);
    for (const int z : {8, 16, 24}) GroundWriter(*this).remove({40, 0, z}, all);
  }
};

TEST(HeightMap, ACeilingShowsWhatIsUnderARoof) {
  constexpr double h = 0.1;
  Cave ground;
  HeightMap heights(ground);
  const MapGrid inside{{-0.5, -0.5}, h, 10, 10}, beside{{5, 5}, h, 4, 4};
  for (const double z : map_of(heights, inside, MapLayer::kHeight)) EXPECT_NEAR(z, 2, 0.01);
  for (const double z : map_of(heights, inside, MapLayer::kHeight, 0.6))
    EXPECT_NEAR(z, -0.05, 1e-9);
  // To the voxel: its side nearest to 0.6 m.
  for (const double z : map_of(heights, beside, MapLayer::kHeight, 0.6))
    EXPECT_NEAR(z, 0.55, 0.051);
  for (const double z : map_of(heights, inside, MapLayer::kHeight, 30.0)) EXPECT_NEAR(z, 2, 0.01);
  for (const double d : map_of(heights, MapGrid{{-3, -3}, h, 60, 60}, MapLayer::kDug, 1.5))
    EXPECT_NEAR(d, 0, 1e-9) << "a ceiling is over the terrain as well";
  EXPECT_NEAR(map_of(heights, beside, MapLayer::kHeight, -0.25)[0], -0.25, 1e-9);
  std::vector<double> again = map_of(heights, inside, MapLayer::kHeight);
  EXPECT_NEAR(again[0], 2, 0.01) << "a ceiling is of one look";
}

TEST(HeightMap, LooseSoilIsWhatLiesOnTheBank) {
  Ground ground(0.1, Vec3(0, 0, 0), make_plane(0, {0.05, 0}));
  Tracker tracker(ground, {digger()}, loam_with_pours({{"tip", {0, 0, 3}, 0, 0, 1.5}}));
  tracker.pour(0, 1);
  HeightMap heights(ground);
  const MapGrid grid = over_site(0.1, {0, 0});
  EXPECT_NEAR(sum_of(map_of(heights, grid, MapLayer::kLoose)) * 0.01, 1.5, 2e-4);
  EXPECT_NEAR(sum_of(map_of(heights, grid, MapLayer::kDug)) * 0.01, -1.5, 2e-4);
}

TEST(HeightMap, EndsWithTheTerrain) {
  HeightGrid posts;
  posts.nx = posts.ny = 21;
  posts.first = {-1, -1};
  posts.spacing = {0.1, 0.1};
  Ground ground(0.1, Vec3(0, 0, 0), raster(posts, [](double, double) { return 0.5; }));
  HeightMap heights(ground);
  const std::vector<double> map = map_of(heights, MapGrid{{-2, 0}, 0.5, 9, 1}, MapLayer::kHeight);
  EXPECT_TRUE(std::isnan(map.front()) && std::isnan(map.back()));
  EXPECT_NEAR(map[4], 0.5, 0.01);
  const std::vector<Vec2> places = {
      {0, 0}, {3, 0}, {1e12, 0}, {std::numeric_limits<double>::quiet_NaN(), 0}};
  std::vector<double> z(places.size());
  heights.at(places, z).check();
  EXPECT_NEAR(z[0], 0.5, 1e-9);
  for (const std::size_t i : {1, 2, 3}) EXPECT_TRUE(std::isnan(z[i])) << i;
}

/// A small hole at the corner of four columns, of which each has it at another corner.
TEST(HeightMap, EndsInEachColumnThatAHoleReaches) {
  HeightGrid posts;
  posts.nx = posts.ny = 101;
  posts.first = {-0.5, -0.5};
  posts.spacing = {0.01, 0.01};
  Ground ground(0.1, Vec3(0, 0, 0), raster(posts, [](double x, double y) {
                  const bool hole = std::abs(x - 0.05) < 0.015 && std::abs(y - 0.15) < 0.015;
                  return hole ? std::numeric_limits<double>::quiet_NaN() : 0.04;
                }));
  HeightMap heights(ground);
  const MapGrid grid{{-0.3, -0.3}, 0.1, 7, 7};
  const std::vector<double> map = map_of(heights, grid, MapLayer::kHeight);
  for (int i = 0; i < grid.ny; ++i) {
    for (int j = 0; j < grid.nx; ++j) {
      const Vec2 from_hole = grid.middle_m(i, j) - Vec2(0.05, 0.15);
      EXPECT_EQ(std::isnan(map[static_cast<std::size_t>(i * grid.nx + j)]),
                from_hole.cwiseAbs().maxCoeff() < 0.06)
          << from_hole.transpose();
    }
  }
}

// A hole that misses the middles and corners of columns of voxels, so that no voxel is ever full.
TEST(HeightMap, EndsAboveASmallHoleAndABottomlessSite) {
  HeightGrid posts;
  posts.nx = posts.ny = 81;
  posts.first = {-0.8, -0.8};
  posts.spacing = {0.02, 0.02};
  Ground ground(0.1, Vec3(0, 0, 0), raster(posts, [](double x, double y) {
                  const bool hole = std::abs(x - 0.02) < 0.005 && std::abs(y - 0.02) < 0.005;
                  return hole ? std::numeric_limits<double>::quiet_NaN() : 0.04;
                }));
  HeightMap heights(ground);
  GroundWriter(ground).remove({0, 0, 0}, SampleWords{1});
  std::vector<double> out(64);
  heights.map(MapGrid{{0, 0}, 0.1, 8, 8}, MapLayer::kDug, std::span<double>(out)).check();
  const Vec2 nowhere(std::numeric_limits<double>::quiet_NaN(), 0);
  heights.at({&nowhere, 1}, out).check();
  EXPECT_TRUE(std::isnan(out[0]));
  Ground high(0.05, Vec3(0, 0, 1e9), make_plane(0, {0.1, 0}));
  const Vec2 place(3, 0);
  HeightMap(high).at({&place, 1}, out).check();
  EXPECT_NEAR(out[0], 0.3, 1e-9);
}

TEST(HeightMap, WhatNobodyTouchedIsNotDug) {
  HeightGrid posts;
  posts.nx = posts.ny = 81;
  posts.first = {-2, -2};
  posts.spacing = {0.05, 0.05};
  // Walls that are higher than counts look, and fine ones between points at which heights are
  // asked.
  Ground ground(0.05, Vec3(0, 0, 0), raster(posts, [](double x, double y) {
                  return (x > 0.31 ? 2.5 : 0.0) + (y > 0.7 ? 0.4 * std::floor(4 * y) : 0.1 * x);
                }));
  HeightMap heights(ground);
  std::mt19937_64 random(5);
  for (int n = 0; n < 30; ++n) {
    const auto cell = [&] { return kChunkSide * (static_cast<int>(random() % 6) - 3); };
    const Coord3 origin(cell(), cell(), kChunkSide * (static_cast<int>(random() % 9) - 1));
    SampleWords words{};
    words[random() % words.size()] = random();
    GroundWriter(ground).remove(origin, words);
  }
  const MapGrid grid{{-1.5, -1.5}, 0.05, 60, 60};
  const std::vector<double> dug = map_of(heights, grid, MapLayer::kDug);
  const auto changed = std::count_if(dug.begin(), dug.end(), [](double d) { return d != 0; });
  EXPECT_GE(changed, 1);
  EXPECT_LE(changed, 30);
}

TEST(HeightMap, TheFootOfAHighWallIsSeen) {
  HeightGrid posts;
  posts.nx = posts.ny = 81;
  posts.first = {-2, -2};
  posts.spacing = {0.05, 0.05};
  Ground ground(0.05, Vec3(0, 0, 0),
                raster(posts, [](double x, double) { return x > 0.21 ? 6.0 : 0.0; }));
  HeightMap heights(ground);
  const MapGrid grid{{-1.5, -1.5}, 0.05, 60, 60};
  for (const MapLayer layer : {MapLayer::kLoose, MapLayer::kDug})
    for (const double v : map_of(heights, grid, layer)) ASSERT_EQ(v, 0);
  SampleWords foot{};
  for (int x = 0; x < 3; ++x)  // of the tile that the wall stands in, at x = 0.2 m
    for (int y = 0; y < kChunkSide; ++y)
      for (int z = 0; z < kChunkSide; ++z)
        foot[static_cast<std::size_t>(cell_number({x, y, z}))] = kAllSoil;
  GroundWriter(ground).remove({0, 0, -8}, foot);
  const std::vector<double> dug = map_of(heights, grid, MapLayer::kDug);
  EXPECT_NEAR(sum_of(dug) * 0.05 * 0.05, -ground.change_m3(), 1e-9);
  EXPECT_EQ(std::count_if(dug.begin(), dug.end(), [](double d) { return d != 0; }), 24);
  const Vec2 in_it(0.05, 0.2);
  double z;
  heights.at({&in_it, 1}, {&z, 1}).check();
  EXPECT_LT(z, -0.3);
}

TEST(HeightMap, WhatAToolCutFromTheSideCountsUpToACell) {
  Ground ground(0.1, Vec3(0, 0, 0), make_plane(2, {0, 0}));
  HeightMap heights(ground);
  SampleWords eighth;
  eighth.fill(0x0101010101010101);
  for (const int z : {0, 8}) {  // a cell of each column; then two, so that what is above is a roof
    GroundWriter(ground).remove({0, 0, z}, eighth);
    const std::vector<double> dug = map_of(heights, over_site(0.1, {0, 0}), MapLayer::kDug);
    if (z == 0) {
      EXPECT_NEAR(sum_of(dug) * 0.01, -ground.change_m3(), 1e-9);
    } else {
      EXPECT_EQ(*std::max_element(dug.begin(), dug.end()), 0);
    }
  }
}

/// Of columns that are as they were but for these, a cell in all, and of shafts.
TEST(HeightMap, PoresCountDownTo32VoxelsBelowTheTopmostFullOne) {
  for (const int deep : {0, 1, 7, 8, 100, 103}) {
    Ground ground(0.1, Vec3(0, 0, 0), make_plane(0.04, {0, 0}));  // voxel -1 is full
    HeightMap heights(ground);
    const auto remove = [&](int z, std::uint64_t samples) {
      const int low = floor_to(z, kChunkSide);
      SampleWords words{};
      words[static_cast<std::size_t>(cell_number({3, 4, z - low}))] = samples;
      GroundWriter(ground).remove({0, 0, low}, words);
    };
    for (int z = 0; z > -deep; --z) remove(z, kAllSoil);
    const int full = std::min(-1, -deep);
    for (const int below : {32, 25, 8, 1}) {
      remove(full - below, 0x1111111111111111);
      const double dug_m3 = sum_of(map_of(heights, over_site(0.1, {0, 0}), MapLayer::kDug)) * 0.01;
      EXPECT_NEAR(dug_m3, -ground.change_m3(), 1e-9) << deep << ", " << below;
    }
  }
}

TEST(HeightMap, QuarterTurnsAreExactToo) {
  std::mt19937_64 random(6);
  Ground ground(0.1, Vec3(0, 0, 0), make_plane(0, {0.1, 0.05}));
  Tracker tracker(ground, {digger()});
  for (const Pose& pose : random_way(random)) tracker.update(0, pose);
  HeightMap heights(ground);
  const int n = 9, m = 5;
  const auto map_at = [&](double yaw) {
    const Pose pose{{0.31, -0.22, 0}, from_rpy(0, 0.3, yaw)};  // with rounding
    return map_of(heights, MapGrid::around(pose.position.head<2>(), 0.17, n, n, &pose),
                  MapLayer::kHeight);
  };
  const std::vector<double> level = map_at(0);
  for (int turn = 1; turn < 4; ++turn) {
    const std::vector<double> turned = map_at(turn * std::numbers::pi / 2);
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        int x = j, y = i;  // of the cell in the level map
        for (int t = 0; t < turn; ++t) std::tie(x, y) = std::pair(n - 1 - y, x);
        EXPECT_NEAR(turned[static_cast<std::size_t>(n * i + j)],
                    level[static_cast<std::size_t>(n * y + x)], 1e-9);
      }
    }
  }
  const Pose north{{0, 0, 0}, from_rpy(0, 0, std::numbers::pi / 2)};
  const MapGrid wide = MapGrid::around({0, 0}, 0.1, n, m, &north);
  EXPECT_NEAR(wide.middle_m(0, n - 1).y(), 0.4, 1e-12);
  EXPECT_NEAR(wide.middle_m(m - 1, 0).x(), -0.2, 1e-12);
  EXPECT_EQ(map_of(heights, wide, MapLayer::kHeight).size(), 45u);
}

TEST(HeightMap, FloatsAreTheDoublesRounded) {
  Ground ground(0.1, Vec3(0, 0, 0), make_plane(1, {0.3, 0.1}));
  HeightMap heights(ground);
  const MapGrid grid{{0.03, 0.04}, 0.17, 40, 30};
  std::vector<float> small(40 * 30);
  heights.map(grid, MapLayer::kHeight, std::span<float>(small)).check();
  const std::vector<double> exact = map_of(heights, grid, MapLayer::kHeight);
  for (std::size_t i = 0; i < small.size(); ++i) ASSERT_EQ(small[i], static_cast<float>(exact[i]));
}

/// Anything that a controller looks at, around a place.
void look_around(HeightMap& heights, const Pose& at, std::mt19937_64& random,
                 std::span<double> out) {
  std::uniform_real_distribution<double> any(-2, 2);
  std::array<Vec2, 200> places;
  for (Vec2& place : places) place = at.position.head<2>() + Vec2(any(random), any(random));
  heights.at({places.data(), 1}, out).check();
  heights.at(places, out).check();
  heights.at(places, out, at.position.z()).check();
  for (const double cell_m : {0.1, 0.13})
    for (const MapLayer layer : {MapLayer::kHeight, MapLayer::kLoose, MapLayer::kDug})
      for (const Pose* turn : {static_cast<const Pose*>(nullptr), &at}) {
        const MapGrid grid = MapGrid::around(at.position.head<2>(), cell_m, 32, 32, turn);
        heights.map(grid, layer, out).check();
      }
  heights
      .map(MapGrid::around(at.position.head<2>(), 0.1, 32, 32, &at), MapLayer::kHeight, out,
           at.position.z())
      .check();
  const double yaw = any(random);
  const Vec2 along(0.1 * std::cos(yaw), 0.1 * std::sin(yaw)), across(-along.y(), along.x());
  heights.lines(at.position.head<2>() - 10 * along, along, 20, across, 20, out);
}

/// Whatever digs, tips and slides, for machines that were anywhere in a prepared area.
TEST(HeightMap, LooksAfterUpdatesAllocateNothing) {
#ifndef SOILVDB_COUNTS_ALLOCATIONS
  GTEST_SKIP() << "allocations are not counted";
#endif
  std::vector<std::shared_ptr<const InitialTerrain>> all = terrains();
  all.push_back(make_level_set_surface(level_set_sphere(20.0f, {0, 0, -19.8f}, 0.25f), {0, 0, 0}));
  for (std::size_t n = 0; n < all.size(); ++n) {
    Work work(all[n], 14 + n);
    HeightMap heights(work.ground);
    heights.prepare({Vec2(-10, -10), Vec2(10, 10)}).check();
    std::mt19937_64 random(15);
    std::vector<double> out(32 * 32);
    look_around(heights, work.at[0], random, out);
    for (int step = 0; step < (kLong ? 400 : 40); ++step) {
      work.step();
      const Pose& at = work.at[random() % work.at.size()];
      const std::size_t before = allocations;
      look_around(heights, at, random, out);
      ASSERT_EQ(allocations, before) << n << ", " << step;
    }
    EXPECT_GT(work.ground.chunk_count(), 8u);
    HeightMap fresh(work.ground);
    const MapGrid grid = over_site(0.1, {0, 0});
    const std::vector<double> kept = map_of(heights, grid, MapLayer::kHeight),
                              anew = map_of(fresh, grid, MapLayer::kHeight);
    for (std::size_t i = 0; i < kept.size(); ++i)
      ASSERT_TRUE(kept[i] == anew[i] || (std::isnan(kept[i]) && std::isnan(anew[i])));
  }
}

TEST(HeightMap, LookingAgainAllocatesNothing) {
  Work work(make_plane(0, {0.02, 0.05}), 14);
  for (int n = 0; n < 20; ++n) work.step();
  HeightMap heights(work.ground);
  std::vector<Vec3> ways;
  for (int n = 0; n < 200; ++n) ways.emplace_back(std::cos(n), std::sin(n), -1);
  std::vector<double> out(32 * 32);
  const Vec3 eye(0, 0, 3);
  const auto look = [&] {
    std::mt19937_64 random(15);
    look_around(heights, {{0.01, 0, -0.2}, from_rpy(0, 0, 0.5)}, random, out);
    heights.cast({&eye, 1}, ways, std::span(out).first(ways.size())).check();
  };
  look();
  const std::size_t before = allocations;
  look();
  EXPECT_EQ(allocations, before);
}

TEST(HeightMap, ACeilingIsForPlacesToo) {
  constexpr double h = 0.1;
  Cave ground;
  HeightMap heights(ground);
  const auto at = [&](double x, double y, std::optional<double> ceiling_m = {}) {
    const Vec2 place(x, y);
    double z = 0;
    heights.at({&place, 1}, {&z, 1}, ceiling_m).check();
    return z;
  };
  const double floor = -0.05, of_trench = 0.75;
  for (const Vec2& in : {Vec2(0, 0), Vec2(-0.41, 0.33)}) {
    EXPECT_NEAR(at(in.x(), in.y()), 2, 1e-9);
    for (const double ceiling : {0.74, 0.6, 0.06})
      EXPECT_NEAR(at(in.x(), in.y(), ceiling), floor, 1e-9) << ceiling;
    EXPECT_NEAR(at(in.x(), in.y(), 1.55), 1.55, 1e-9) << "in the roof";
    EXPECT_NEAR(at(in.x(), in.y(), 30.0), 2, 1e-9);
  }
  EXPECT_NEAR(at(4.3, 0.3), of_trench, 1e-9);
  EXPECT_NEAR(at(4.3, 0.3, 1.55), of_trench, 1e-9);
  EXPECT_NEAR(at(4.3, 0.3, 0.35), 0.35, 1e-9) << "below its floor";
  for (const double far : {5.5, 100.0, 1e9}) {  // also where no voxel can be
    EXPECT_NEAR(at(far, 0.3, 0.55), 0.55, 1e-9);
    EXPECT_EQ(at(far, 0.3, 2.3), 2);
    EXPECT_EQ(at(far, 0.3, 1e300), 2);
    EXPECT_EQ(at(far, 0.3), 2);
  }
  // Many places at once are as each alone, and a map has the same columns.
  std::vector<Vec2> places;
  const MapGrid grid{{-1.5, -1.5}, h, 70, 30};
  for (int i = 0; i < grid.ny; ++i)
    for (int j = 0; j < grid.nx; ++j) places.push_back(grid.middle_m(i, j));
  std::vector<double> z(places.size());
  for (const double ceiling : {0.55, 1.15, 5.0}) {
    heights.at(places, z, ceiling).check();
    const std::vector<double> map = map_of(heights, grid, MapLayer::kHeight, ceiling);
    for (std::size_t i = 0; i < z.size(); ++i) {
      ASSERT_EQ(z[i], at(places[i].x(), places[i].y(), ceiling));
      ASSERT_NEAR(z[i], map[i], 0.01) << ceiling;
    }
  }
  EXPECT_EQ(heights.at({places.data(), 1}, z, std::numeric_limits<double>::quiet_NaN()).why,
            "a ceiling must be a number");
  EXPECT_TRUE(std::isnan(z[0]) && !std::isnan(z[1])) << "what was not asked for stays";
}

TEST(HeightMap, PreparesAnAreaWithinReason) {
  Ground ground(0.1, Vec3(5e5, 5e6, 0), make_plane(0, {0, 0}));
  HeightMap heights(ground);
  const Vec2 here(5e5, 5e6);
  const auto why = [&](const Vec2& low, const Vec2& high) {
    return heights.prepare({Vec2(here + low), Vec2(here + high)}).why;
  };
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(why({0, 0}, {50, 50}), "");
  EXPECT_EQ(why({0, 0}, {0, 0}), "") << "a place is an area, too";
  EXPECT_EQ(why({0, 0}, {100, 100}), "an area must have at most 8192 times 8 x 8 voxels");
  EXPECT_EQ(why({1, 0}, {0, 1}), "an area must have its corners in order");
  for (const double bad : {kNone, 1e12, std::numeric_limits<double>::infinity()})
    EXPECT_FALSE(heights.prepare({here, Vec2(bad, here.y() + 1)}).ok()) << bad;
}

/// Looks there may also read columns beside it.
TEST(HeightMap, PreparedAreasAreWholeToTheirBorders) {
#ifndef SOILVDB_COUNTS_ALLOCATIONS
  GTEST_SKIP() << "allocations are not counted";
#endif
  Ground ground(0.1, Vec3(0, 0, 0), make_plane(0, {0.02, 0.05}));
  HeightMap heights(ground);
  std::mt19937_64 random(18);
  std::uniform_real_distribution<double> any(-0.4, 0.4);
  std::vector<double> out(9);
  const auto look_in = [&](const Eigen::AlignedBox2d& area) {
    const Vec2 low = area.min(), high = area.max();
    for (const Vec2& at : {low, high, Vec2(low.x(), high.y()), Vec2(high.x(), low.y())}) {
      heights.at({&at, 1}, out).check();
      const Vec2 in = (area.center() - at).cwiseSign();
      for (const double cell_m : {0.1, 0.13}) {
        const Vec2 first = at + cell_m * (1.5 * in - Vec2(1, 1));  // of 3 x 3 cells in the corner
        heights.map({first, cell_m, 3, 3}, MapLayer::kHeight, std::span<double>(out)).check();
      }
    }
  };
  const Vec2 half(0.5, 0.5), far(900, 900);
  heights.prepare({Vec2(far - 3 * half), Vec2(far + 3 * half)}).check();
  look_in({Vec2(far - half), Vec2(far + half)});  // gets the memory for looks
  for (int n = 0; n < 60; ++n) {
    const Vec2 middle(5 * n + any(random), any(random));
    const Eigen::AlignedBox2d area(Vec2(middle - half), Vec2(middle + half));
    heights.prepare(area).check();
    const std::size_t before = allocations;
    look_in(area);
    EXPECT_EQ(allocations, before) << n;
  }
}

TEST(HeightMap, RefusesWhatIsNoMap) {
  Ground ground(0.1, Vec3(0, 0, 0), make_plane(0, {0, 0}));
  HeightMap heights(ground);
  std::vector<double> out(6);
  const auto refuses = [&](const MapGrid& grid, std::optional<double> ceiling_m = {}) {
    std::fill(out.begin(), out.end(), 7);
    const LookResult made = heights.map(grid, MapLayer::kHeight, std::span<double>(out), ceiling_m);
    EXPECT_EQ(made.fault, LookResult::Fault::kBadRequest);
    EXPECT_NE(made.why, "");
    EXPECT_THROW(made.check(), std::invalid_argument);
    for (const double z : out) EXPECT_TRUE(std::isnan(z));
  };
  const MapGrid good{{0, 0}, 0.1, 3, 2};
  EXPECT_TRUE(heights.map(good, MapLayer::kHeight, std::span<double>(out)).ok());
  const auto with = [&](auto change) {
    MapGrid grid = good;
    change(grid);
    refuses(grid);
  };
  with([](MapGrid& g) { g.nx = 0; });
  with([](MapGrid& g) { g.ny = 3; });
  with([](MapGrid& g) {
    g.nx = -3;
    g.ny = -2;
  });
  for (const double side : {0.0, 1e-8, -1.0, std::numeric_limits<double>::quiet_NaN(), 1e9})
    with([&](MapGrid& g) { g.cell_m = side; });
  for (const double x : {1e9, -1e9, std::numeric_limits<double>::quiet_NaN()})
    with([&](MapGrid& g) { g.first_m.x() = x; });
  with([](MapGrid& g) { g.along = {1, 1}; });
  with([](MapGrid& g) { g.along = {std::numeric_limits<double>::quiet_NaN(), 0}; });
  refuses(good, std::numeric_limits<double>::quiet_NaN());
  std::vector<double> none;
  EXPECT_FALSE(heights.at(std::vector<Vec2>{{0, 0}}, none).ok());
}

}  // namespace height_map_test
}  // namespace soilvdb::test
