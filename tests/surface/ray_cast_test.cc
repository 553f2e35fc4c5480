// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rays stop at the surface that heights tell, whatever they leap over.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/ground_grids.h"
#include "soilvdb/height_map.h"
#include "tests/support/earthmoving_fixture.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace ray_cast_test {

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();
/// Error of a ray's height where it stops, m: rounding, and halvings of a step.
constexpr double kStopError = 1e-6;

struct Rays {
  std::vector<Vec3> origins, directions;

  void add(const Vec3& origin, const Vec3& direction) {
    origins.push_back(origin);
    directions.push_back(direction);
  }
  std::size_t size() const { return origins.size(); }
};

std::vector<double> cast(HeightMap& heights, const Rays& rays) {
  std::vector<double> ranges(rays.size(), -1);
  heights.cast(rays.origins, rays.directions, ranges).check();
  return ranges;
}

double cast_one(HeightMap& heights, const Vec3& origin, const Vec3& direction) {
  double range = -1;
  heights.cast({&origin, 1}, {&direction, 1}, {&range, 1}).check();
  return range;
}

/// From around a place into all directions, most of them down.
Rays random_rays(std::mt19937_64& random, int count, const Vec3& around) {
  std::uniform_real_distribution<double> wide(-5, 5), high(-1, 3), any(-1, 1);
  Rays rays;
  for (int n = 0; n < count; ++n) {
    const Vec3 origin = around + Vec3(wide(random), wide(random), high(random));
    Vec3 direction(any(random), any(random), any(random) - 0.5);
    if (n % 10 == 0) direction = {0, 0, -1};
    if (n % 10 == 1) direction.x() = 0;
    if (n % 10 == 2) direction.z() = 0;
    if (n % 10 == 3) direction.y() = 1e-13;
    rays.add(origin, direction);
  }
  return rays;
}

/// Compares rays with heights at many places along them. A ray that stops before a step reaches
/// the ground must be at the ground there.
/// @return share of those that stop, and do so at a face that stands upright
double expect_along(HeightMap& heights, const Rays& rays, double step_m, double far_m) {
  const std::vector<double> ranges = cast(heights, rays);
  std::vector<Vec2> places(static_cast<std::size_t>(far_m / step_m));
  std::vector<double> ground(places.size());
  int stopped = 0, upright = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Vec3 origin = rays.origins[i], along = rays.directions[i].normalized();
    const auto is_below = [&](double t) {
      const Vec3 p = origin + t * along;
      const Vec2 xy = p.head<2>();
      double z;
      heights.at({&xy, 1}, {&z, 1}).check();
      return p.z() <= z;  // not where there is no ground
    };
    for (std::size_t n = 0; n < places.size(); ++n)
      places[n] = (origin + step_m * static_cast<double>(n) * along).head<2>();
    heights.at(places, ground).check();
    double first = kInfinite;
    for (std::size_t n = 0; n < places.size() && first == kInfinite; ++n) {
      const double t = step_m * static_cast<double>(n);
      if (origin.z() + t * along.z() <= ground[n]) first = t;
    }
    const double range = ranges[i];
    EXPECT_GE(range, 0) << i;
    EXPECT_LE(range, first + kStopError) << "ray " << i << " passes ground";
    if (range == 0) {
      EXPECT_TRUE(is_below(0)) << i;
    } else if (range < far_m) {
      const Vec3 p = origin + range * along;
      const Vec2 xy = p.head<2>();
      double z;
      heights.at({&xy, 1}, {&z, 1}).check();
      ++stopped;
      if (std::abs(z - p.z()) < kStopError) continue;
      ++upright;
      EXPECT_FALSE(is_below(range - kStopError)) << "ray " << i << " stops late at " << range;
      EXPECT_TRUE(is_below(range + kStopError)) << "ray " << i << " stops early at " << range;
    }
  }
  EXPECT_GT(stopped, static_cast<int>(rays.size()) / 5);
  return static_cast<double>(upright) / std::max(stopped, 1);
}

TEST(RayCast, StopsWhereHeightsSayThatGroundIs) {
  const auto raster_with_holes = [] {
    const HeightGrid grid{61, 91, {-6.03, -5.02}, {0.2, 0.12}};
    return raster(grid, [](double x, double y) {
      const bool hole = std::hypot(x - 0.4, y) < 0.5 || (x > 2.9 && y > 1.3);
      return hole ? kNotANumber : 0.3 * std::sin(2 * x) * std::cos(3 * y);
    });
  };
  std::vector<std::shared_ptr<const InitialTerrain>> all = terrains();
  all.push_back(raster_with_holes());
  std::mt19937_64 random(1);
  std::uint64_t seed = 0;
  for (const auto& terrain : all) {
    for (const double voxel_size_m : {0.1, 0.17}) {
      Work work(terrain, ++seed, voxel_size_m);
      HeightMap heights(work.ground);
      for (int n = 0; n < (kLong ? 8 : 2); ++n) {
        for (int step = 0; step < 12; ++step) {
          try {
            work.step();
          } catch (const NoGroundError&) {  // so near holes
          }
        }
        SCOPED_TRACE(seed);
        const double upright =
            expect_along(heights, random_rays(random, kSanitized ? 40 : 150, {0, 0, 0}), 0.013, 12);
        EXPECT_LT(upright, 0.5);
      }
    }
  }
}

TEST(RayCast, StopsOnTerrainsThatOnlyTellHeights) {
  const auto below = std::make_shared<Ground>(0.2, Vec3(0, 0, 0), make_plane(0.1, {0.1, -0.05}));
  Tracker digs(*below, {digger()});
  for (const Pose& pose : drag({-2, 0, 0.1}, 4, 0.6, 12)) digs.update(0, pose);
  openvdb::initialize();
  const auto sphere = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(
      4, openvdb::Vec3f(0, 0, -3.5f), 0.1f);
  std::mt19937_64 random(2);
  for (const auto& terrain : {std::shared_ptr(make_ground_terrain(below)),
                              std::shared_ptr(make_level_set_surface(sphere, {0, 0, 0}))}) {
    Ground ground(0.1, Vec3(0, 0, 0), terrain);
    HeightMap heights(ground);
    Tracker tracker(ground, {digger()});
    for (const Pose& pose : drag({-0.9, 0.6, 0.1}, 2, 0.4, 12)) tracker.update(0, pose);
    expect_along(heights, random_rays(random, 40, {0, 0, 0}), 0.02, 8);
  }
}

TEST(RayCast, PlanesAreExact) {
  const Vec3 place(500000, 5400000, 300);
  const Vec2 slope(0.3, -0.2);
  const double height = place.z() - slope.dot(place.head<2>());
  Ground ground(0.05, place, make_plane(height, slope));
  HeightMap heights(ground);
  const Vec3 normal = Vec3(-slope.x(), -slope.y(), 1);
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> any(-1, 1);
  for (int n = 0; n < 2000; ++n) {
    const Vec3 offset(100 * any(random), 100 * any(random), 50 + 40 * any(random));
    Vec3 direction(any(random), any(random), any(random));
    direction *= std::pow(10, 8 * any(random));
    const double sinks = -normal.dot(direction.normalized());
    const double above = normal.dot(offset);
    const double wanted = above <= 0 ? 0 : sinks > 0 ? above / sinks : kInfinite;
    const double range = cast_one(heights, place + offset, direction);
    // Rounding of coordinates in metres, magnified where the ray grazes.
    if (wanted == kInfinite)
      ASSERT_EQ(range, wanted);
    else
      ASSERT_NEAR(range, wanted, 1e-9 * wanted + 1e-8 / std::max(sinks, 1e-9)) << n;
  }
}

/// A ground at z = 1.55 m with columns dug to whole voxels, so that heights are exact.
class Blocks {
 public:
  static constexpr double kVoxel = 0.1, kTop = 1.55;

  explicit Blocks() : ground(kVoxel, Vec3(0, 0, 0), make_plane(kTop, {0, 0})) {}
  /// Removes the cells of a column from `low` up.
  void dig(int x, int y, int low) {
    const Coord2 tile = floor_to(Coord2(x, y), kChunkSide);
    for (int z = floor_to(low, kChunkSide); z < 16; z += kChunkSide) {
      SampleWords words{};
      for (int k = std::max(low, z); k < std::min(z + kChunkSide, 16); ++k)
        words[static_cast<std::size_t>(cell_number({x, y, k}))] = kAllSoil;
      GroundWriter(ground).remove({tile.x(), tile.y(), z}, words);
    }
  }

  Ground ground;
};

TEST(RayCast, WallsStandBetweenTheirColumns) {
  Blocks blocks;
  for (int x = 0; x < 8; ++x)
    for (int y = -40; y < 40; ++y) blocks.dig(x, y, 0);
  HeightMap heights(blocks.ground);
  constexpr double kFloor = -0.05;
  for (const double z : {0.0, 0.31, 1.0, 1.5}) {
    // Linear from the middle of the last dug column to that of the next.
    const double share = (z - kFloor) / (Blocks::kTop - kFloor);
    EXPECT_NEAR(cast_one(heights, {0.35, 0.3, z}, {1, 0, 0}), 0.35 + 0.1 * share, 1e-9);
    EXPECT_NEAR(cast_one(heights, {0.35, 0.3, z}, {-1, 0, 0}), 0.35 + 0.1 * share, 1e-9);
    // Steeply down either wall: from above its foot to the floor, and from its top to the wall.
    EXPECT_NEAR(cast_one(heights, {0.65, 0.3, z}, {1, 0, -1e3}), z - kFloor, 1e-5);
    EXPECT_NEAR(cast_one(heights, {0.05, 0.3, z}, {-1, 0, -1e3}), z - kFloor, 1e-5);
  }
  for (const double side : {-1.0, 1.0}) {
    const Vec3 from(0.35 + side * 0.45, 0.1, 3), to(0.35 + side * 0.4, 0.1, 0.1);
    const Vec3 down = (to - from).normalized();
    const Vec3 at = from + cast_one(heights, from, down) * down;
    const double out = std::abs(at.x() - 0.35) - 0.35;  // beyond the middle of the last dug column
    EXPECT_NEAR(at.z(), kFloor + (Blocks::kTop - kFloor) * out / 0.1, 1e-8);
    EXPECT_GT(out, 0);
    EXPECT_LT(out, 0.1);
  }
  // Along the trench to its end, and over it without a look into it.
  EXPECT_NEAR(cast_one(heights, {0.35, 0, 0.75}, {0, 1, 0}), 3.95, 1e-9);
  EXPECT_EQ(cast_one(heights, {-2, 0, 1.5501}, {1, 0.1, 0}), kInfinite);
  EXPECT_NEAR(cast_one(heights, {-2, 0, 1.65}, {1, 0, -0.1 / 1.85}),
              1.85 * std::hypot(1, 0.1 / 1.85), 1e-9);
}

TEST(RayCast, MeetsAPatchFromItsSaddle) {
  Blocks blocks;  // two columns that touch at a corner, between two that are 0.8 m lower
  for (int x = 0; x < 8; ++x)
    for (int y = 0; y < 8; ++y)
      if (x != y || (x != 3 && x != 4)) blocks.dig(x, y, 8);
  HeightMap heights(blocks.ground);
  // Over the saddle's middle, at index 11.5, it rises by 16 s^2 along the diagonal.
  const Vec3 from(0.35, 0.35, 1.2);
  for (const double side : {-1.0, 1.0}) {
    EXPECT_NEAR(cast_one(heights, from, {side, side, 0}), 0.1 * std::sqrt(2 * 0.5 / 16), 1e-9);
    EXPECT_NEAR(cast_one(heights, from, {side, side, 1}),
                0.1 * std::sqrt(3) * (1 + std::sqrt(33)) / 32, 1e-9);
    EXPECT_GT(cast_one(heights, from, {side, -side, -0.1}), 0.1 * std::sqrt(0.5));
  }
  EXPECT_NEAR(cast_one(heights, from, {0, 0, -1}), 0.05, 1e-9);
}

TEST(RayCast, TurnsWithTheGround) {
  Blocks as_is, turned;
  std::mt19937_64 random(4);
  for (int n = 0; n < 150; ++n) {
    const int x = static_cast<int>(random() % 60) - 30, y = static_cast<int>(random() % 60) - 30;
    const int low = static_cast<int>(random() % 16), side = 1 + static_cast<int>(random() % 6);
    for (int i = x; i < x + side; ++i)
      for (int j = y; j < y + side; ++j) {
        as_is.dig(i, j, low);
        turned.dig(-j, i, low);
      }
  }
  Rays rays = random_rays(random, 1000, {0, 0, 1.5}), rays_turned;
  const auto turn = [](const Vec3& p) { return Vec3(-p.y(), p.x(), p.z()); };
  for (std::size_t i = 0; i < rays.size(); ++i)
    rays_turned.add(turn(rays.origins[i]), turn(rays.directions[i]));
  HeightMap heights(as_is.ground), heights_turned(turned.ground);
  const std::vector<double> a = cast(heights, rays), b = cast(heights_turned, rays_turned);
  int stopped = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    stopped += a[i] > 0 && a[i] < kInfinite;
    if (a[i] == kInfinite)
      EXPECT_EQ(b[i], kInfinite);
    else
      EXPECT_NEAR(a[i], b[i], 1e-9 * (1 + a[i])) << i;
  }
  EXPECT_GT(stopped, 300);
}

TEST(RayCast, ThreadsAndOrderChangeNoBit) {
  for (const auto& terrain : terrains()) {
    Work work(terrain, 5);
    for (int n = 0; n < 20; ++n) work.step();
    std::mt19937_64 random(6);
    const Rays rays = random_rays(random, 3000, {0, 0, 0});
    std::vector<std::vector<double>> all;
    for (const int threads : {1, 2}) {
      HeightMap heights(work.ground);
      tbb::task_arena arena(threads);
      all.push_back(arena.execute([&] { return cast(heights, rays); }));
    }
    EXPECT_EQ(all[0], all[1]);
    HeightMap heights(work.ground);
    for (std::size_t i = rays.size(); i-- > 0;)
      ASSERT_EQ(cast_one(heights, rays.origins[i], rays.directions[i]), all[0][i]) << i;
    // One origin for all, and one by one.
    std::vector<double> together(rays.size());
    heights.cast({rays.origins.data(), 1}, rays.directions, together).check();
    for (std::size_t i = 0; i < rays.size(); ++i)
      ASSERT_EQ(cast_one(heights, rays.origins[0], rays.directions[i]), together[i]) << i;
  }
}

TEST(RayCast, NeighboursChangeNoBit) {
  std::mt19937_64 random(13);
  std::uniform_real_distribution<double> any(-1, 1);
  std::uint64_t seed = 20;
  for (const auto& terrain : terrains()) {
    Work work(terrain, ++seed);
    for (int n = 0; n < 25; ++n) work.step();
    HeightMap heights(work.ground);
    const double h = work.ground.voxel_size_m();
    for (int beam = 0; beam < (kSanitized ? 20 : 1000); ++beam) {
      Vec3 origin(6 * any(random), 6 * any(random), 2 + 2 * any(random));
      if (beam % 4 == 3) origin *= beam % 8 == 3 ? 4 : 30;  // beside the site
      const Vec3 target(3 * any(random), 3 * any(random), -0.3);
      Vec3 ahead = target - origin;
      if (beam % 5 == 2) ahead.z() *= 0.1;  // grazes
      // Some through corners and along borders of cells, where the way is decided by rounding.
      const bool is_even = beam % 3 == 0;
      if (is_even) {
        for (double& x : origin) x = h * std::round(2 * x / h) / 2;
        for (double& x : ahead) x = std::round(2 * x) / 2;
      }
      const double wide = is_even ? 0.125 : std::pow(10, -2.5 + any(random));
      std::vector<Vec3> ways;
      for (int n = 0; n < 200; ++n) {
        const Vec3 beside = beam % 2 == 0 ? Vec3(n % 20 - 10, n / 20 - 5, 0)
                                          : Vec3(10 * any(random), 10 * any(random), any(random));
        ways.emplace_back(ahead + wide * beside);
        if (ways.back().isZero()) ways.back() = {0, 0, -1};
        if (n % 50 == 49) ways.back() = {any(random), any(random), any(random)};  // not a neighbour
      }
      std::vector<double> together(ways.size());
      heights.cast({&origin, 1}, ways, together).check();
      for (std::size_t i = 0; i < ways.size(); ++i)
        ASSERT_EQ(cast_one(heights, origin, ways[i]), together[i]) << beam << ", " << i;
      const std::vector<Vec3> origins(ways.size(), origin);  // one for each
      std::vector<double> each(ways.size());
      heights.cast(origins, ways, each).check();
      ASSERT_EQ(each, together);
    }
  }
}

TEST(RayCast, KeepsNothingThatIsNoLongerSo) {
  Work work(make_plane(0, {0.1, 0.05}), 7);
  HeightMap kept(work.ground);
  std::mt19937_64 random(8);
  const Rays rays = random_rays(random, 600, {0, 0, 0});
  std::vector<double> before = cast(kept, rays);
  for (const double range : before) EXPECT_GE(range, 0);
  int changed = 0;
  for (int n = 0; n < 12; ++n) {
    for (int step = 0; step < 8; ++step) work.step();
    HeightMap fresh(work.ground);
    const std::vector<double> now = cast(kept, rays);
    ASSERT_EQ(now, cast(fresh, rays)) << n;
    changed += now != before;
    before = now;
  }
  EXPECT_GT(changed, 3);
  const std::unique_ptr<Ground> clone = work.ground.clone();
  HeightMap of_clone(*clone, kept);
  EXPECT_EQ(cast(of_clone, rays), before);
}

TEST(RayCast, PassesHolesAndStopsAtTheirFarSide) {
  const HeightGrid grid{41, 41, {-2, -2}, {0.1, 0.1}};
  Ground ground(0.1, Vec3(0, 0, 0), raster(grid, [](double x, double) {
                  return x > -0.45 && x < 0.65 ? kNotANumber : 0.5;  // ground to -0.5, from 0.7 on
                }));
  HeightMap heights(ground);
  EXPECT_EQ(cast_one(heights, {0, 0, 2}, {0, 0, -1}), kInfinite);
  EXPECT_NEAR(cast_one(heights, {0, 0, 2}, {0.1, 0.1, -1}), 7 * Vec3(0.1, 0.1, -1).norm(), 1e-6)
      << "however deep";
  EXPECT_NEAR(cast_one(heights, {-1, 0, 2}, {0, 0, -1}), 1.5, 1e-9);
  EXPECT_NEAR(cast_one(heights, {0, 0, 0.2}, {1, 0, 0}), 0.7, 1e-6);
  EXPECT_NEAR(cast_one(heights, {0, 0, 0.2}, {-2, 0, 0}), 0.5, 1e-6);
  EXPECT_EQ(cast_one(heights, {0, 0, 0.2}, {0, 1, 0}), kInfinite);
  EXPECT_EQ(cast_one(heights, {-1, 0, 0.6}, {1, 0, 0}), kInfinite);
  EXPECT_EQ(cast_one(heights, {-1, 0, 0.6}, {-1, 0, -0.01}), kInfinite)
      << "beyond the raster's end";
  EXPECT_NEAR(cast_one(heights, {-9, 0, 0.2}, {1, 0, 0}), 7, 1e-9) << "its side";
}

TEST(RayCast, GoesOnWhereAHillWasTakenAway) {
  const auto hill = [](double x, double) { return x > 4.2 ? 5 : -0.3 * x; };
  const HeightGrid grid{41, 41, {-10, -10}, {0.5, 0.5}};
  for (const bool is_plane : {true, false}) {
    Ground ground(0.05, Vec3(0, 0, 0), is_plane ? make_plane(0, {-0.3, 0}) : raster(grid, hill));
    Tracker tracker(ground, {Bucket{3, 2, {}, {}}});
    for (const double x : {-3.0, 1.0}) tracker.update(0, {{x, 0, 0}, {1, 0, 0, 0}});
    HeightMap heights(ground);
    const Vec3 from(-1, 0.2, 0.1);  // below the hill that was there
    const double range = cast_one(heights, from, {1, 0, 0});
    if (is_plane)
      EXPECT_EQ(range, kInfinite);
    else  // to the cliff, from -1.2 m at x = 4 m to 5 m at 4.5 m
      EXPECT_NEAR(range, 5 + 0.5 * 1.3 / 6.2, 1e-6);
    EXPECT_GT(cast_one(heights, from, {1, 0, 0.01}), 5);
    EXPECT_NEAR(cast_one(heights, from, {0, 0, -1}), 0.1, 0.1 * 0.05);
  }
}

TEST(RayCast, CutsBesideHolesEndHalfwayToThem) {
  const HeightGrid grid{81, 81, {-4, -4}, {0.1, 0.1}};
  Ground ground(0.1, Vec3(0, 0, 0), raster(grid, [](double x, double) {
                  return x > -0.45 && x < 0.65 ? kNotANumber : 0.5;  // ground to -0.5, from 0.7 on
                }));
  SampleWords words{};
  for (int y = 0; y < kChunkSide; ++y)
    for (int z = 0; z < kChunkSide; ++z)  // columns -6 and -7; column -5 is cut by the hole
      for (const int x : {-6, -7})
        words[static_cast<std::size_t>(cell_number({x, y, z}))] = kAllSoil;
  GroundWriter(ground).remove({-8, 0, 0}, words);
  HeightMap heights(ground);
  EXPECT_NEAR(cast_one(heights, {-0.57, 0.35, 2}, {0, 0, -1}), 2.05, 1e-8);
  EXPECT_NEAR(cast_one(heights, {-0.52, 0.35, 2}, {0, 0, -1}), 1.5, 1e-8) << "the terrain";
  EXPECT_NEAR(cast_one(heights, {-0.64, 0.35, 0.2}, {1, 0, 0}), 0.09, 1e-8) << "its side";
  EXPECT_NEAR(cast_one(heights, {-0.64, 0.35, 0.45}, {1, 0, -10}), 0.5 * std::hypot(1, 0.1), 1e-8);
  std::mt19937_64 random(12);
  std::uniform_real_distribution<double> any(-0.15, 0.15);
  Rays rays;
  for (int n = 0; n < 300; ++n)
    rays.add({-0.55 + any(random), 0.35 + 3 * any(random), 0.6 + any(random)},
             {any(random), any(random), any(random) - 0.1});
  expect_along(heights, rays, 0.003, 2);
}

TEST(RayCast, FarRaysAreExactAndQuick) {
  Work work(make_plane(0.2, {0, 0}), 9);
  for (int n = 0; n < 20; ++n) work.step();
  HeightMap heights(work.ground);
  // Out of the index range, too, and back over the site.
  for (const double far_m : {1e3, 1e5, 1e7, 1e9}) {
    const Vec3 from(-3, 1, 50.2);
    const double range = cast_one(heights, from, {far_m, 0.3 * far_m, -50});
    EXPECT_NEAR(range, Vec3(far_m, 0.3 * far_m, 50).norm(), 1e-7 * range);
    EXPECT_EQ(cast_one(heights, from, {far_m, 1, 0}), kInfinite);
    const Vec3 away(-far_m, 0.3 * far_m, 0.2 + far_m), aim = Vec3(1.7, 0.3, 0.2) - away;
    const double back = cast_one(heights, away, aim);
    EXPECT_NEAR(back, aim.norm(), 2 + 1e-7 * far_m);
  }
  EXPECT_EQ(cast_one(heights, {1e300, 0, 0.3}, {-1, 0, 0}), kInfinite);
  const HeightGrid grid{4001, 4001, {-2000, -2000}, {1, 1}};
  Ground wide(0.05, Vec3(0, 0, 0),
              raster(grid, [](double x, double y) { return x > 1900 ? 30.0 : 0.001 * (x - y); }));
  Tracker tracker(wide, {digger()});
  for (const Pose& pose : drag({-2, 0, 0.1}, 4, 0.5, 12)) tracker.update(0, pose);
  HeightMap over(wide);
  Rays rays;
  for (int n = 0; n < 2000; ++n) rays.add({-1950, 0.01 * n, 10}, {1, 0, 0});
  const std::vector<double> first = cast(over, rays);
  // The wall between posts at 1900 m and 1901 m.
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Vec2 at(rays.origins[i].x() + first[i], rays.origins[i].y());
    double z;
    over.at({&at, 1}, {&z, 1}).check();
    ASSERT_NEAR(z, 10, 1e-6);
    ASSERT_NEAR(first[i], 3850.5, 0.5);
  }
  const std::clock_t begin = std::clock();
  EXPECT_EQ(cast(over, rays), first);
  EXPECT_LT(std::clock() - begin, cpu_s(0.1)) << "50 us a ray";
}

/// Where floats are farther apart than samples.
TEST(RayCast, StopsAtEdgesFarAboveTheOrigin) {
  constexpr double h = 0.1;
  constexpr int kTop = 1 << 20;  // the topmost cell
  Ground ground(h, Vec3(0, 0, 0), make_plane(h * (kTop + 0.5), {0, 0}));
  SampleWords words{};
  for (int n = 0; n < kChunkVoxels; ++n) {
    const Coord3 cell = numbered_voxel(n);
    const bool is_pit = cell.x() < 4;
    if (cell.z() == 0) words[static_cast<std::size_t>(n)] = is_pit ? kAllSoil : 0x7fff;
  }
  GroundWriter(ground).remove({0, 0, kTop}, words);
  HeightMap heights(ground);
  for (int missing = 1; missing < 10; ++missing) {  // down from the edge
    const double z = h * (kTop + 0.5 - (15 + 0.1 * missing) / 64);
    EXPECT_NEAR(cast_one(heights, {0.2, 0.3, z}, {1, 0, 0}), 0.2, 0.1) << missing;
  }
}

TEST(RayCast, CutsMayBeFarApart) {
  Blocks blocks;
  constexpr int kFar = 1 << 20;
  for (const int first : {0, kFar})
    for (int n = 0; n < 64; ++n) blocks.dig(first + n % 8, first + n / 8, 0);
  HeightMap heights(blocks.ground);
  const double far_m = Blocks::kVoxel * kFar;
  for (const double at : {0.35, far_m + 0.35}) {
    EXPECT_NEAR(cast_one(heights, {at, at, 3}, {0, 0, -1}), 3.05, 1e-9);
    EXPECT_NEAR(cast_one(heights, {at, at + 2, 3}, {0, 0, -1}), 3 - Blocks::kTop, 1e-9);
  }
  const Vec3 half(far_m / 2, far_m / 2, Blocks::kTop), from(0, 0, 1000);
  EXPECT_NEAR(cast_one(heights, from, half - from), (half - from).norm(), 1e-6);
  const Vec3 end(far_m + 0.35, far_m + 0.35, 0), high = end + Vec3(-20, -20, 300);
  EXPECT_NEAR(cast_one(heights, high, end - high), (end - high).norm() * 300.05 / 300, 1e-6);
}

/// What is dug elsewhere changes no range to here, alone or among neighbours, and takes no time.
TEST(RayCast, GroundBetweenCutsIsPassedAtOnce) {
  constexpr double kFarX = 150'000, kFarY = 70'000;
  const auto dug = [](bool far, std::unique_ptr<Ground>& ground) {
    ground = std::make_unique<Ground>(0.05, Vec3(0, 0, 0), make_plane(0, {0, 0}));
    Tracker tracker(*ground, {digger()});
    for (const double x : {0.0, kFarX}) {
      if (x > 0 && !far) continue;
      for (Pose pose : drag({-2, 0, 0.1}, 4, 0.5, 12)) {
        pose.position += Vec3(x, x * kFarY / kFarX, 0);
        tracker.update(0, pose);
      }
    }
  };
  std::unique_ptr<Ground> one, two;
  dug(false, one);
  dug(true, two);
  HeightMap of_one(*one), of_two(*two);
  std::mt19937_64 random(13);
  Rays rays = random_rays(random, 2000, {0, 0, 1});
  for (int n = 0; n < 2000; ++n)  // a picture's neighbours, some of which look to the far cut
    rays.add({-4, -3, 1.5}, {1, 0.4 + 1e-4 * n, -0.4 + 2e-4 * n});
  const std::vector<double> near = cast(of_one, rays);
  EXPECT_EQ(cast(of_two, rays), near);
  Rays level;
  for (int n = 0; n < 2000; ++n) level.add({0, 0, 0.3 + 1e-3 * n}, {kFarX, kFarY, 1});
  const std::clock_t begin = std::clock();
  for (const double range : cast(of_two, level)) EXPECT_EQ(range, kInfinite);
  EXPECT_LT(std::clock() - begin, cpu_s(0.1)) << "50 us a ray over 50 000 empty pages";
}

TEST(RayCast, UndergroundIsThereAtOnce) {
  Work work(make_plane(0.2, {0, 0}), 10);
  for (int n = 0; n < 20; ++n) work.step();
  HeightMap heights(work.ground);
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> any(-5, 5);
  for (int n = 0; n < 300; ++n) {
    const Vec2 at(any(random), any(random));
    double z;
    heights.at({&at, 1}, {&z, 1}).check();
    const Vec3 away(any(random), any(random), any(random));
    EXPECT_EQ(cast_one(heights, {at.x(), at.y(), z - 1e-6}, away), 0);
    EXPECT_GT(cast_one(heights, {at.x(), at.y(), z + 1e-6}, away), 0);
  }
}

TEST(RayCast, RefusesWhatIsNoRay) {
  Ground ground(0.1, Vec3(0, 0, 0), make_plane(0, {0, 0}));
  HeightMap heights(ground);
  Rays good;
  for (int n = 0; n < 1000; ++n) good.add({0, 0, 1}, {0, 0, -1e-200});
  for (const double range : cast(heights, good)) ASSERT_NEAR(range, 1, 1e-12);
  const auto complaint = [&](const Rays& rays) -> std::string {
    std::vector<double> ranges(rays.directions.size());
    const LookResult made = heights.cast(rays.origins, rays.directions, ranges);
    for (const double range : ranges) EXPECT_TRUE(std::isnan(range));
    EXPECT_EQ(made.fault, LookResult::Fault::kBadRequest);
    return made.why;
  };
  for (const double bad : {kNotANumber, kInfinite}) {
    Rays rays = good;
    rays.origins[900].y() = bad;
    EXPECT_THAT(complaint(rays), testing::HasSubstr("ray 900: its origin"));
    rays.directions[703].z() = bad;
    EXPECT_THAT(complaint(rays), testing::HasSubstr("ray 703: its direction"));
    rays.directions[3] = {0, 0, 0};
    EXPECT_THAT(complaint(rays), testing::HasSubstr("ray 3: its direction must not be zero"));
  }
  std::vector<double> ranges(2);
  EXPECT_FALSE(heights.cast(good.origins, good.directions, ranges).ok());
  EXPECT_FALSE(heights.cast({good.origins.data(), 3}, {good.directions.data(), 2}, ranges).ok());
  heights.cast({good.origins.data(), 1}, {}, {}).check();
}

}  // namespace ray_cast_test
}  // namespace soilvdb::test
