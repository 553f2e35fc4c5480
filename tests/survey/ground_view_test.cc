// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a sensor is expected to see is what rays meet that are cast one by one.
#include "core/survey/ground_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "core/ground/ground_writer.h"
#include "tests/support/earthmoving_fixture.h"

namespace soilvdb::test {
namespace ground_view_test {

constexpr double kVoxel_m = 0.1;
/// By how far the view's surface may be from that of rays, m: between columns that nobody touched
/// it is not the terrain's own, and beside those it has not their counted heights.
constexpr double kApart_m = kVoxel_m / 20;

std::shared_ptr<const InitialTerrain> slope() {
  return raster({101, 101, {-40, -40}, {0.8, 0.8}},
                [](double x, double y) { return 0.1 * x - 0.05 * y; });
}
std::shared_ptr<const InitialTerrain> slope_with_voids() {
  return raster({101, 101, {-40, -40}, {0.8, 0.8}}, [](double x, double y) {
    return std::sin(3 * x) * std::sin(2 * y) > 0.7 ? std::nan("") : 0.1 * x - 0.05 * y;
  });
}

ScanRays rays_of(const std::vector<Vec3>& ways) {
  ScanRays rays;
  rays.resize(ways.size());
  for (std::size_t i = 0; i < ways.size(); ++i) {
    const Vec3 along = ways[i].normalized();
    rays.x[i] = static_cast<float>(along.x());
    rays.y[i] = static_cast<float>(along.y());
    rays.z[i] = static_cast<float>(along.z());
    rays.length_m[i] = 1;
  }
  return rays;
}

std::vector<Vec3> random_ways(std::uint64_t seed, int count) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> any(-1, 1);
  std::vector<Vec3> ways;
  for (int n = 0; n < count; ++n) {
    Vec3 way(any(random), any(random), any(random) - 0.6);
    if (n % 50 == 0) way = {0, 0, -1};
    if (n % 50 == 1) way.y() = way.x();  // between two faces
    ways.push_back(way);
  }
  return ways;
}

std::vector<float> seen(GroundView& view, const Vec3& from, const std::vector<Vec3>& ways) {
  std::vector<float> ranges(ways.size());
  view.ranges(from, rays_of(ways), ranges);
  return ranges;
}

/// Casts the same rays. @return share of them that end elsewhere by more than the surfaces differ
double share_elsewhere(HeightMap& map, const Vec3& from, const std::vector<Vec3>& ways,
                       const std::vector<float>& ranges) {
  const ScanRays rays = rays_of(ways);
  std::vector<Vec3> along;
  for (std::size_t i = 0; i < ways.size(); ++i) along.emplace_back(rays.x[i], rays.y[i], rays.z[i]);
  std::vector<double> cast(ways.size());
  map.cast(std::span(&from, 1), along, cast).check();
  int apart = 0;
  for (std::size_t i = 0; i < ways.size(); ++i) {
    if (static_cast<float>(cast[i]) == ranges[i]) continue;  // it was cast
    // The surface passes within kApart_m of where the view has it.
    const double range = ranges[i];
    const Vec3 end = from + range * along[i];
    std::vector<Vec2> places;
    for (const double dx : {-1, 0, 1})
      for (const double dy : {-1, 0, 1})
        places.emplace_back(end.x() + kApart_m * dx, end.y() + kApart_m * dy);
    std::vector<double> heights(places.size());
    map.at(places, heights).check();
    const auto [low, high] = std::minmax_element(heights.begin(), heights.end());
    const bool is_at =
        std::isfinite(range) && end.z() > *low - kApart_m && end.z() < *high + kApart_m;
    // And no ground before it.
    const double flat = std::abs(along[i].z());
    apart += !is_at || std::abs(range - cast[i]) > 0.5 * kVoxel_m / std::max(flat, 0.1);
  }
  return apart / static_cast<double>(ways.size());
}

class GroundViews : public testing::TestWithParam<std::uint64_t> {};

TEST_P(GroundViews, ShowWhatRaysMeet) {
  Work work(slope(), GetParam());
  HeightMap map(work.ground);
  GroundView view(work.ground, map);
  for (int round = 0; round < 3; ++round) {
    for (int i = 0; i < 15; ++i) work.step();
    const Vec3 from(2.0 * round - 2, 0.7 * round, 2.5 + 0.3 * round);
    const std::vector<Vec3> ways = random_ways(GetParam() + 10, 20000);
    const std::vector<float> ranges = seen(view, from, ways);
    // Rays that graze an edge may pass it or not.
    EXPECT_LT(share_elsewhere(map, from, ways, ranges), 0.002);
    // A view that saw nothing before shows the same.
    HeightMap new_map(work.ground);
    GroundView new_view(work.ground, new_map);
    EXPECT_EQ(ranges, seen(new_view, from, ways));
    // So do some rays alone, in another order.
    std::vector<Vec3> some;
    std::vector<float> of_some;
    for (std::size_t i = ways.size(); i-- > 0;) {
      if (i % 3 != round % 3u) continue;
      some.push_back(ways[i]);
      of_some.push_back(ranges[i]);
    }
    EXPECT_EQ(of_some, seen(view, from, some));
    GroundView only(work.ground, new_map);
    EXPECT_EQ(of_some.front(), seen(only, from, {some.front()}).front());
  }
}

TEST_P(GroundViews, PassVoids) {
  Work work(slope_with_voids(), GetParam());
  for (int i = 0; i < 20; ++i) work.step();
  HeightMap map(work.ground);
  GroundView view(work.ground, map);
  const Vec3 from(0.3, -1, 3);
  const std::vector<Vec3> ways = random_ways(GetParam(), 20000);
  EXPECT_LT(share_elsewhere(map, from, ways, seen(view, from, ways)), 0.004);
}

INSTANTIATE_TEST_SUITE_P(Seeds, GroundViews, testing::Range<std::uint64_t>(1, 4));

TEST(GroundView, IsOfTheGroundAsItIs) {
  Work work(slope(), 1);
  HeightMap map(work.ground);
  GroundView view(work.ground, map);
  const Vec3 from(0.5, 0.5, 4);
  const std::vector<Vec3> down = {{0.01, 0.02, -1}};
  EXPECT_NEAR(seen(view, from, down).front(), 4 - 0.025, 0.01);
  SampleWords all;
  all.fill(kAllSoil);
  GroundWriter(work.ground).add({0, 0, 0}, all);
  GroundWriter(work.ground).add({0, 0, 8}, all);
  EXPECT_NEAR(seen(view, from, down).front(), 4 - 1.55, 0.01);
}

TEST(GroundView, OfAPlaceInOrNearTheGroundIsCast) {
  Work work(slope(), 2);
  for (int i = 0; i < 20; ++i) work.step();
  HeightMap map(work.ground);
  GroundView view(work.ground, map);
  const std::vector<Vec3> ways = random_ways(3, 500);
  for (const double above : {-0.5, 0.02, 0.2}) {
    const Vec2 place(0.4, 0.3);
    double height = 0;
    map.at({&place, 1}, {&height, 1}).check();
    const Vec3 from(place.x(), place.y(), height + above);
    const std::vector<float> ranges = seen(view, from, ways);
    if (above < 0) {
      EXPECT_EQ(ranges, std::vector<float>(ways.size(), 0.0f));
    }
    EXPECT_EQ(share_elsewhere(map, from, ways, ranges), 0);
  }
}

TEST(GroundView, WallsThatRiseAboveThePlaceHideWhatIsBehind) {
  Work work(raster({101, 101, {-40, -40}, {0.8, 0.8}}, [](double, double) { return 0.0; }), 1);
  SampleWords all;
  all.fill(kAllSoil);
  for (int y = -16; y <= 16; y += kChunkSide)
    for (int z = 0; z < 6; ++z) GroundWriter(work.ground).add({8, y, z * kChunkSide}, all);
  HeightMap map(work.ground);
  GroundView view(work.ground, map);
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> any(-1, 1);
  std::vector<Vec3> ways;
  for (int n = 0; n < 20000; ++n) ways.emplace_back(0.9 + any(random), any(random), -1);
  for (const double height_m : {2.0, 3.0}) {
    const Vec3 from(0.3, 0.4, height_m);
    EXPECT_LT(share_elsewhere(map, from, ways, seen(view, from, ways)), 0.001) << height_m;
  }
}

TEST(GroundView, BumpsHideWhatIsBehindOnEachSide) {
  const auto rough = [](double x, double y) {  // as if at random
    const double any = 43758.5453 * std::sin(12.9898 * x + 78.233 * y);
    return 1.5 * kVoxel_m * (2 * (any - std::floor(any)) - 1);
  };
  Work work(raster({401, 401, {-20, -20}, {kVoxel_m, kVoxel_m}}, rough), 1);
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> any(-1, 1);
  HeightMap map(work.ground);
  GroundView view(work.ground, map);
  const Vec3 from(0.03, 0.02, 3);
  for (const double x : {-1, 1}) {
    for (const double y : {-1, 1}) {
      std::vector<Vec3> ways;
      for (int n = 0; n < 10000; ++n)
        ways.emplace_back(x * std::abs(any(random)), y * std::abs(any(random)), -1);
      // Bumps of less than a pixel may be passed by.
      EXPECT_LT(share_elsewhere(map, from, ways, seen(view, from, ways)), 0.004) << x << ' ' << y;
    }
  }
}

TEST(GroundView, ReachesBeyondWhatIsDrawn) {
  Work work(raster({101, 101, {-500, -500}, {10, 10}}, [](double x, double) { return 0.1 * x; }),
            1);
  HeightMap map(work.ground);
  GroundView view(work.ground, map);
  const float range = seen(view, {0, 0, 5}, {{1, 0, -0.1}}).front();
  EXPECT_NEAR(range, 25 * std::hypot(1, 0.1), 1e-3);
}

}  // namespace ground_view_test
}  // namespace soilvdb::test
