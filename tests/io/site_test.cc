// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/site.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>

#include "io/scenario/workspace.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/surface_height.h"
#include "tests/support/site_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace site_test {

using test::TempFolder;
using ::testing::HasSubstr;

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

/// 40 m x 40 m at (1000, 2000), 10 m high, with a hole of no height about (1030, 2020).
std::filesystem::path raster_with_hole(const TempFolder& folder) {
  HeightGrid grid{41, 41, {1000, 2000}, {1, 1}};
  std::vector<float> heights(41 * 41, 10);
  for (int y = 15; y <= 25; ++y) {
    for (int x = 25; x <= 35; ++x) heights[y * 41 + x] = kNone;
  }
  write_geotiff(folder / "hole.tif", grid, {{"z", heights}}, "");
  return folder / "hole.tif";
}

TEST(Site, ItsOriginIsThatOfTheLatticeNearTheFirstLip) {
  const Vec3 lip(556449.9, 5394951, 540);
  const Site site = open_site(scenario_of(PlaneTerrain{0, {0, 0}}, lip, lip + Vec3(1.1, 0, 0)));
  const double period = 6553.6;
  EXPECT_NEAR((site.ground->origin() - Vec3(85 * period, 823 * period, 0)).norm(), 0, 1e-9);
  EXPECT_EQ(site.ground->voxel_size_m(), 0.1);
  EXPECT_TRUE(std::isinf(site.bounds.max().x()));
  EXPECT_EQ(site.reference.checksum, "");
  EXPECT_TRUE(site.ground->chunks().empty());
}

TEST(Site, RunsOnOneTerrainShareItsLatticeWhateverLipComesFirst) {
  const TempFolder folder;
  const Terrain terrain = RasterTerrain{raster_with_hole(folder)};
  const Site a = open_site(scenario_of(terrain, {1002, 2003, 9}, {1005, 2003, 9}));
  const Site b = open_site(scenario_of(terrain, {1038, 2036, 11}, {1035, 2036, 9}));
  EXPECT_EQ(a.ground->origin(), b.ground->origin());
}

TEST(Site, ARasterIsItsTerrainInItsOwnCoordinates) {
  const TempFolder folder;
  const Site site = open_site(
      scenario_of(RasterTerrain{raster_with_hole(folder)}, {1005, 2010, 9}, {1008, 2010, 9}));
  EXPECT_EQ(surface_height(*site.ground, 1005.5, 2010.5), 10);
  EXPECT_EQ(surface_height(*site.ground, 1030, 2020), std::nullopt);
  EXPECT_EQ(site.bounds.min(), Vec2(1000, 2000));
  EXPECT_EQ(site.bounds.max(), Vec2(1040, 2040));
  EXPECT_TRUE(std::get<RasterTerrain>(site.reference.terrain).file.is_absolute());
  EXPECT_EQ(site.reference.checksum.size(), 16u);
}

TEST(Site, AMotionThatNeverComesOverTheTerrainIsRefusedWithBothBoxes) {
  const TempFolder folder;
  const Terrain terrain = RasterTerrain{raster_with_hole(folder)};
  const std::string message = refusal(folder, [&] {
    open_site(scenario_of(terrain, {12, 0, 0}, {14, 0, 0}));
  });
  EXPECT_THAT(message, HasSubstr("dig.yaml: no bucket ever comes over the terrain"));
  EXPECT_THAT(message, HasSubstr("the terrain covers x 1000.0 to 1040.0, y 2000.0 to 2040.0"));
}

TEST(Site, DiggingWhereThereIsNoHeightIsRefusedBeforeTheRun) {
  const TempFolder folder;
  const Terrain terrain = RasterTerrain{raster_with_hole(folder)};
  const std::string message = refusal(folder, [&] {
    open_site(scenario_of(terrain, {1010, 2020, 9}, {1030, 2020, 9}));
  });
  EXPECT_THAT(message, HasSubstr("dig.yaml: machine 'digger' reaches ground without a height"));
  EXPECT_THAT(message, HasSubstr("between 0 s and 10 s, at x 102"));
}

TEST(Site, PassingHighOverNoHeightIsFine) {
  const TempFolder folder;
  const Terrain terrain = RasterTerrain{raster_with_hole(folder)};
  EXPECT_NO_THROW(open_site(scenario_of(terrain, {1010, 2020, 10.1}, {1038, 2020, 10.1})));
  EXPECT_NO_THROW(open_site(scenario_of(terrain, {1010, 2005, 9}, {1038, 2005, 9})));
}

TEST(Site, DiggingBeyondTheEdgeIsRefusedToo) {
  const TempFolder folder;
  const Terrain terrain = RasterTerrain{raster_with_hole(folder)};
  EXPECT_THAT(refusal(folder,
                      [&] {
                        open_site(scenario_of(terrain, {1035, 2005, 9}, {1045, 2005, 9}));
                      }),
              HasSubstr("reaches ground without a height"));
}

TEST(Site, AVoxelSizeBeyondTheMemoryIsRefusedWithOneThatWouldDo) {
  const TempFolder folder;
  Scenario scenario = scenario_of(PlaneTerrain{0, {0, 0}}, {0, 0, -0.4}, {20, 0, -0.4});
  scenario.voxel_size_m = 1e-4;
  const std::string message = refusal(folder, [&] { open_site(scenario); });
  ASSERT_THAT(message, HasSubstr("voxel_size 0.0001 is too small for what is dug"));
  const auto end = message.rfind(" would do");
  const auto begin = message.rfind(' ', end - 1) + 1;
  scenario.voxel_size_m = std::stod(message.substr(begin, end - begin));
  EXPECT_GT(scenario.voxel_size_m, 1e-4);
  EXPECT_NO_THROW(open_site(scenario)) << message;
  // Nothing is dug above the ground, however small the voxels.
  scenario = scenario_of(PlaneTerrain{-10, {0, 0}}, {0, 0, 0}, {20, 0, 0});
  scenario.voxel_size_m = 1e-4;
  EXPECT_NO_THROW(open_site(scenario));
}

/// Flat ground, 20 km x 20 km; counts the posts that are read.
class CountedHeights final : public HeightSource {
 public:
  void read(int, int, int nx, int ny, float* out) const override {
    posts += std::int64_t{nx} * ny;
    std::fill_n(out, std::int64_t{nx} * ny, 0.0f);
  }
  mutable std::int64_t posts = 0;
};

TEST(Site, AStepAcrossALargeRasterReadsOnlyWhatIsBeneathIt) {
  constexpr int kSide = 20'000;
  const auto heights = std::make_shared<CountedHeights>();
  Site site;
  site.ground = std::make_unique<Ground>(
      0.1, Vec3::Zero(), make_height_field({kSide, kSide, {0, 0}, {1, 1}}, heights));
  site.bounds = {Vec2(0, 0), Vec2(kSide - 1, kSide - 1)};
  Scenario scenario = scenario_of(PlaneTerrain{}, {10, 10, 5}, {19'000, 19'000, 5});
  scenario.raster_cell_m = 0.1;
  check_workspace(scenario, site);
  // The tiles that the diagonal crosses are less than 4 in each of its 313 rows of tiles.
  EXPECT_LT(heights->posts, 313 * 4 * 64 * 64);
}

TEST(Site, AMotionBeyondWhatVoxelsCanNumberIsRefused) {
  const TempFolder folder;
  EXPECT_THAT(refusal(folder,
                      [&] {
                        open_site(scenario_of(PlaneTerrain{0, {0, 0}}, {0, 0, 1}, {1e7, 0, 1}));
                      }),
              HasSubstr("machine 'digger' goes"));
}

TEST(Site, RealTerrainIsOpened) {
  if (!std::filesystem::exists(shared("dem/dtm.tif"))) GTEST_SKIP() << "not there";
  const Site site = open_site(scenario_of(RasterTerrain{shared("dem/dtm.tif")},
                                          {321700, 4297700, 11}, {321703, 4297700, 11}));
  EXPECT_TRUE(surface_height(*site.ground, 321700, 4297700).has_value());
  const TempFolder folder;
  EXPECT_THAT(refusal(folder,
                      [] {
                        open_site(scenario_of(RasterTerrain{shared("dem/hugo_site_filled.asc")},
                                              {8, 8, 1500}, {9, 8, 1500}));
                      }),
              HasSubstr("reaches ground without a height"));
}

io::Scenario of_machines(int machines, double voxel_size_m) {
  io::Scenario scenario;
  scenario.file = "dig.yaml";
  scenario.name = "dig";
  scenario.voxel_size_m = voxel_size_m;
  scenario.terrain = io::PlaneTerrain{0, {0, 0}};
  for (int m = 0; m < machines; ++m) {
    std::vector<double> times_s;
    std::vector<Pose> poses;
    for (int i = 0; i <= 100; ++i) {
      times_s.push_back(i);
      poses.push_back(Pose{{0.1 * i, 10.0 * m, -0.4}});
    }
    scenario.machines.push_back(
        {fmt::format("digger {}", m), Bucket{1, 0.5, {}, {}}, Motion(times_s, poses)});
  }
  return scenario;
}
TEST(Site, WhatAllMachinesDigIsToFitIntoTheMemory) {
  // The smallest voxels that will do for one.
  double least = 1e-4;
  const auto fits = [](int machines, double h) {
    try {
      io::open_site(of_machines(machines, h));
    } catch (const io::InputError&) {
      return false;
    }
    return true;
  };
  while (!fits(1, least)) least *= 1.05;
  // A coarse estimate, too, says that one takes less than a 64th then.
  EXPECT_FALSE(fits(100, 4 * least));
  EXPECT_TRUE(fits(100, 8 * least));
}

}  // namespace site_test
}  // namespace soilvdb::io
