// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground that was dug from ground that was dug: volumes of both.
#include <gtest/gtest.h>

#include <memory>

#include "core/ground/soil_writer.h"
#include "soilvdb/column_gains.h"
#include "soilvdb/difference.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/tracker.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace soil_on_soil_test {

struct Twice {
  std::shared_ptr<Soil> first;
  std::unique_ptr<Soil> second;
  Twice() {
    const std::shared_ptr<const BaseSurface> ground = make_plane(0.013, {0, 0});
    first = std::make_shared<Soil>(0.05, Vec3::Zero(), ground);
    dig(*first, 0);
    second = std::make_unique<Soil>(0.1, Vec3::Zero(), make_soil_surface(first));
    dig(*second, 1);
  }
  static void dig(Soil& soil, double y) {
    Tracker tracker(soil, {Bucket{0.6, 0.5, {}, {}}});
    for (const double x : {0.0, 2.0}) tracker.update(0, Pose{{x, y, -0.3}});
  }
};
TEST(SoilOnSoil, GainsBetweenGroundAndGroundDugFromItSumToTheLedgers) {
  const Twice twice;
  double sum = 0;
  for_each_gain(*twice.first, *twice.second, false, GainGrid::columns({0.01, 0.02}, 0.07),
                [&](const GainGrid::Box&, const Gain& gain) { sum += gain.m3; });
  EXPECT_NEAR(sum, twice.second->change_m3(), 1e-9);
  EXPECT_NEAR(sum, difference(*twice.first, *twice.second, false).net_m3, 1e-9);
}

TEST(SoilOnSoil, ARasterOfGroundDugFromGroundHasWhatWasDugOfBoth) {
  const Twice twice;
  const io::SurfaceRaster raster = io::rasterise(*twice.second, {Vec2(-1, -1), Vec2(3, 2)}, 0.1);
  double sum = 0;
  for (const float z : raster.change) sum += double{z} * 0.1 * 0.1;
  EXPECT_NEAR(sum, twice.first->change_m3() + twice.second->change_m3(), 1e-5);
}

TEST(SoilAboveTheBase, IsFoundInASnapshotToo) {
  const test::TempFolder folder;
  const io::PlaneTerrain plane{0, {0, 0}};
  const io::Site site{
      std::make_unique<Soil>(0.1, Vec3::Zero(), make_plane(0, {0, 0})), {plane, ""}, "", {}};
  SampleWords all;
  all.fill(kAllSoil);
  SoilWriter(*site.soil).add({0, 0, 32}, all);
  io::write_snapshot(folder / "a.vdb", site, {});
  const io::Site read = io::read_snapshot(folder / "a.vdb");
  const Eigen::AlignedBox3d above(Vec3(0, 0, 3), Vec3(1, 1, 4));
  EXPECT_FALSE(site.soil->is_air(above));
  EXPECT_FALSE(read.soil->is_air(above));
}

}  // namespace soil_on_soil_test
}  // namespace soilvdb::test
