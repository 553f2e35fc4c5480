// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground that was dug from ground that was dug: volumes of both.
#include <gtest/gtest.h>

#include <memory>

#include "core/ground/ground_writer.h"
#include "soilvdb/difference.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/tracker.h"
#include "soilvdb/volume_changes.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace ground_on_ground_test {

struct Twice {
  std::shared_ptr<Ground> first;
  std::unique_ptr<Ground> second;
  Twice() {
    const std::shared_ptr<const InitialTerrain> terrain = make_plane(0.013, {0, 0});
    first = std::make_shared<Ground>(0.05, Vec3::Zero(), terrain);
    dig(*first, 0);
    second = std::make_unique<Ground>(0.1, Vec3::Zero(), make_ground_terrain(first));
    dig(*second, 1);
  }
  static void dig(Ground& ground, double y) {
    Tracker tracker(ground, {Bucket{0.6, 0.5, {}, {}}});
    for (const double x : {0.0, 2.0}) tracker.update(0, Pose{{x, y, -0.3}});
  }
};
TEST(GroundOnGround, GainsBetweenGroundAndGroundDugFromItSumToTheLedgers) {
  const Twice twice;
  double sum = 0;
  for_each_volume_change(*twice.first, *twice.second, false,
                         VolumeBins::columns({0.01, 0.02}, 0.07),
                         [&](const VolumeBins::Box&, const VolumeChange& gain) { sum += gain.m3; });
  EXPECT_NEAR(sum, twice.second->change_m3(), 1e-9);
  EXPECT_NEAR(sum, difference(*twice.first, *twice.second, false).net_m3, 1e-9);
}

TEST(GroundOnGround, ARasterOfGroundDugFromGroundHasWhatWasDugOfBoth) {
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
      std::make_unique<Ground>(0.1, Vec3::Zero(), make_plane(0, {0, 0})), {plane, ""}, "", {}};
  SampleWords all;
  all.fill(kAllSoil);
  GroundWriter(*site.ground).add({0, 0, 32}, all);
  io::write_snapshot(folder / "a.vdb", site, {});
  const io::Site read = io::read_snapshot(folder / "a.vdb");
  const Eigen::AlignedBox3d above(Vec3(0, 0, 3), Vec3(1, 1, 4));
  EXPECT_FALSE(site.ground->is_air(above));
  EXPECT_FALSE(read.ground->is_air(above));
}

}  // namespace ground_on_ground_test
}  // namespace soilvdb::test
