// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rasters of the surface and of its change.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <vector>

#include "soilvdb/io/raster.h"
#include "soilvdb/tracker.h"
#include "tests/support/raster_fixture.h"

namespace soilvdb::io {
namespace surface_raster_test {

TEST(Rasterise, CellsLieAtMultiplesOfTheirSizeAndHoldTheSurfaceAndItsChange) {
  const Ground ground(0.1, {0, 0, 0}, make_plane(1, {0.5, -0.25}));
  const SurfaceRaster raster = rasterise(ground, {Vec2(0.3, -0.9), Vec2(2.2, 0.4)}, 0.5);
  EXPECT_EQ(raster.grid.nx, 5);
  EXPECT_EQ(raster.grid.ny, 3);
  EXPECT_EQ(raster.grid.first, Vec2(0.25, -0.75));
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 5; ++i) {
      const double z = 1 + 0.5 * (0.25 + 0.5 * i) - 0.25 * (-0.75 + 0.5 * j);
      EXPECT_EQ(raster.change[j * 5 + i], 0);
      EXPECT_FLOAT_EQ(raster.surface[j * 5 + i], float(z));
    }
  }
  EXPECT_THROW(rasterise(ground, {Vec2(0, 0), Vec2(1, 1)}, 1e-6), std::invalid_argument);
  EXPECT_THROW(rasterise(ground, {Vec2(0, 0), Vec2(1, 1)}, 0), std::invalid_argument);
}

TEST(SurfaceRaster, ItsVolumeIsTheLedgers) {
  for (const double yaw : {0.0, 0.3, 0.9}) {
    for (const double h : {0.05, 0.1}) {
      Ground ground(h, Vec3(400000, 5000000, 100), make_plane(100.013, {0, 0}));
      Bucket bucket;
      bucket.width_m = 0.6;
      bucket.height_m = 1;
      Tracker tracker(ground, {bucket});
      for (int i = 0; i <= 50; ++i) {
        const double s = i / 50.0, x = 2 * s * std::cos(yaw), y = 2 * s * std::sin(yaw);
        tracker.update(
            0, {{400000.2 + x, 5000000.1 + y, 100 - 0.3 * std::sin(3 * s)}, from_rpy(0, 0, yaw)});
      }
      const double cut_m3 = tracker.total().cut_m3();
      // Cells that are a multiple of the voxels, and others.
      for (const double cell_m : {h, 2 * h, 0.25, 0.37}) {
        const SurfaceRaster raster =
            rasterise(ground, {Vec2(399998, 4999998), Vec2(400004, 5000004)}, cell_m);
        double sum = 0;
        for (std::size_t i = 0; i < raster.change.size(); ++i) {
          sum += double{raster.change[i]};
          EXPECT_NEAR(raster.surface[i], raster.base[i] + raster.change[i], 1e-5);
        }
        EXPECT_NEAR(-sum * cell_m * cell_m, cut_m3, 1e-6 * cut_m3) << yaw << " " << cell_m;
      }
    }
  }
}

class Level final : public HeightSource {
  void read(int, int, int nx, int ny, float* out) const override { std::fill_n(out, nx * ny, 7); }
};

double volume_m3(const SurfaceRaster& raster, const std::vector<float>& change) {
  double sum = 0;
  for (const float rise : change) sum += std::isnan(rise) ? 0 : double{rise};
  return sum * raster.grid.spacing.prod();
}

void drag(Ground& ground, double width_m, const Vec3& from, double length_m) {
  Bucket bucket;
  bucket.width_m = width_m;
  bucket.height_m = 1;
  Tracker tracker(ground, {bucket});
  for (const double s : {0.0, length_m})
    tracker.update(0, {from + Vec3(s, 0, 0), Eigen::Quaterniond::Identity()});
}

TEST(SurfaceRaster, HoldsAllThatWasDugAtTheEdgeOfTheTerrain) {
  // Posts from 0.25 to 4.25: a trench along the first, and one into a corner. Cells begin at 0.
  const std::shared_ptr<const InitialTerrain> terrain =
      make_height_field(grid_of(9, 9, {0.25, 0.25}, {0.5, 0.5}), std::make_shared<Level>());
  const Ground before(0.05, Vec3::Zero(), terrain);
  constexpr double kInside = 0.4001, kLength = 1.249;
  for (const Vec3& from : {Vec3(1.013, 0.25 + kInside, 6.61), Vec3(3, 4.25 - kInside, 6.61)}) {
    const double m3 = 0.8 * kLength * 0.39;
    Ground after(0.05, Vec3::Zero(), terrain), fine(0.025, Vec3::Zero(), terrain);
    drag(after, 0.8, from, kLength);
    drag(fine, 0.8, from, kLength);
    EXPECT_NEAR(-after.change_m3(), m3, 2e-3 * m3);
    for (const double cell_m : {0.05, 0.07, 0.3, 1.0}) {
      const SurfaceRaster raster = rasterise(after, {Vec2(-1, -1), Vec2(6, 6)}, cell_m);
      EXPECT_NEAR(volume_m3(raster, raster.change), after.change_m3(), 1e-6 * m3) << cell_m;
      EXPECT_NEAR(volume_m3(raster, rasterise_change(before, after, true, raster)),
                  after.change_m3(), 1e-6 * m3);
      EXPECT_NEAR(volume_m3(raster, rasterise_change(before, fine, true, raster)), fine.change_m3(),
                  1e-6 * m3);
      EXPECT_TRUE(std::isnan(raster.change[0])) << "neither ground nor a change";
      EXPECT_TRUE(std::isnan(raster.surface[0]));
    }
  }
}

TEST(SurfaceRaster, ChangeIsSinceTheGroundBeforeAnyoneDug) {
  const std::shared_ptr<const InitialTerrain> terrain = make_plane(0.013, {0, 0});
  auto first = std::make_shared<Ground>(0.05, Vec3::Zero(), terrain);
  drag(*first, 0.8, {0.113, 0.027, -0.287}, 2);
  // The same digging goes on in the ground itself, and in one with other voxels made from it.
  Ground other(0.025, Vec3::Zero(), make_ground_terrain(first));
  drag(other, 0.8, {1.013, 0.027, -0.487}, 2);
  const double before_m3 = first->change_m3(), after_m3 = before_m3 + other.change_m3();
  EXPECT_NEAR(after_m3, -0.8 * (0.9 * 0.3 + 2 * 0.5), 3e-3);
  const SurfaceRaster raster = rasterise(other, {Vec2(-1, -1), Vec2(4, 1)}, 0.05);
  EXPECT_NEAR(volume_m3(raster, raster.change), after_m3, 1e-5);
  drag(*first, 0.8, {1.013, 0.027, -0.487}, 2);
  const SurfaceRaster same = rasterise(*first, {Vec2(-1, -1), Vec2(4, 1)}, 0.05);
  EXPECT_NEAR(volume_m3(same, same.change), -0.8 * (0.9 * 0.3 + 2 * 0.5), 3e-3);
}

}  // namespace surface_raster_test
}  // namespace soilvdb::io
