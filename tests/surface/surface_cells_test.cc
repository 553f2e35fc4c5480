// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Cells of surfaces one by one: planes, creases, vertices, undug ones.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "core/cell/cell_volume.h"
#include "core/ground/ground_writer.h"
#include "core/surface/sheet_vertex.h"
#include "core/surface/surface.h"
#include "soilvdb/surface_height.h"
#include "soilvdb/tracker.h"
#include "tests/support/solids.h"

namespace soilvdb::test {
namespace surface_cells_test {

TEST(CellVolume, VolumeBelowAPlaneIsThatOfPointsBelowIt) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 100; ++i) {
    const double x = normal(random), y = normal(random);
    const Vec3 n = Vec3(x, y, normal(random) * (i % 3 == 0 ? 0.1 : 1)).normalized();
    CellModel model;
    model.plane[0] = {float(n.x()), float(n.y()), float(n.z()),
                      float(0.6 * (static_cast<double>(random() % 2001) / 1000 - 1))};
    const auto share = [&](double d) {
      constexpr int kSide = 40;
      int below = 0;
      for (int k = 0; k < kSide * kSide * kSide; ++k) {
        const Vec3 p(k / (kSide * kSide) + 0.5, k / kSide % kSide + 0.5, k % kSide + 0.5);
        below += n.dot(p / kSide - Vec3::Constant(0.5)) < d;
      }
      return static_cast<double>(below) / (kSide * kSide * kSide);
    };
    const CellVolume volume = cell_volume(model, Coord3::Zero());
    const double d = double{model.plane[0].d};
    EXPECT_NEAR(volume.soil, share(d), 2e-3) << n.transpose() << ", " << d;
  }
}

TEST(SheetVertex, AVertexStaysInItsDualCellAndAQuarterOfAVoxelAround) {
  std::mt19937 random(5);
  const auto u = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  int out = 0;
  for (int i = 0; i < 10'000; ++i) {
    Crossing crossings[4];
    const int count = 3 + i % 2;
    for (int k = 0; k < count; ++k) {
      const Vec3 n = Vec3(u(-1, 1), u(-1, 1), u(-1, 1)).normalized();
      for (int a = 0; a < 3; ++a) {
        crossings[k].p[a] = a == k % 3 ? float(u(0, 1)) : float(random() % 2);
        crossings[k].n[a] = float(n[a]);
      }
    }
    float at[3];
    place_vertex(crossings, count, at);
    for (const float v : at) out += v < -0.2501f || v > 1.2501f;
  }
  EXPECT_EQ(out, 0);
}

TEST(SurfaceCells, FloorsOfAStepLittleMoreThanAVoxelHighAreKeptApart) {
  constexpr double h = 0.05;
  std::vector<double> errors;
  for (const double yaw : {0.0, 0.3, 0.7}) {
    for (const double deep : {5.0, 5.2, 5.45, 5.7}) {  // voxels
      const Pose at{Vec3(0.013, 0.021, 0), from_rpy(0, 0, yaw)};
      const Solid solid =
          ground_less("step", {0, 0},
                      {{at, Vec3(0.5, 0.4, deep * h)}, {at, Vec3(0.22, 0.6, (deep + 1.3) * h)}});
      for (const Eigen::Vector3f& point : mesh_all(*sampled(solid, h)).points) {
        const Vec3 p = point.cast<double>(), q = at.inverse() * p;
        const bool at_step = std::abs(std::abs(q.x()) - 0.22) < 1.5 * h;
        if (at_step && std::abs(q.y()) < 0.35 && p.z() < -4.5 * h)
          errors.push_back(distance_m(solid, p, 0.01 * h) / h);
      }
    }
  }
  ASSERT_GT(errors.size(), 1000u);
  std::sort(errors.begin(), errors.end());
  EXPECT_LE(errors[errors.size() * 99 / 100], kVertexError);
}

TEST(SurfaceCells, VerticesOfUndugCellsStayOnTheBaseSurface) {
  constexpr double h = 0.05;
  const Vec2 slope(0.1, -0.2);
  Ground ground(h, Vec3::Zero(), make_plane(0.013, slope));
  Tracker tracker(ground, {Bucket{0.6, 1, {}, {}}});
  for (int i = 0; i <= 20; ++i)
    tracker.update(0, {{0.1 * i, 0.05 * i, -0.02 * i}, from_rpy(0.1, 0.2, 0.4)});
  const std::vector<Coord3> chunks = ground.origins();
  int base = 0;
  double most = 0;
  for (const Coord3& chunk : chunks) {
    const SurfaceBlock surface(ground, {&chunk, 1}, SurfaceBlock::kMesh);
    for (const ContourVertex& v : surface.contour().vertices) {
      if (!v.base) continue;
      const Vec3 p =
          h * ((surface.first() + v.cell).cast<double>() + Vec3(v.in[0], v.in[1], v.in[2]));
      most = std::max(most, std::abs(p.z() - 0.013 - slope.dot(p.head<2>())) / h);
      ++base;
    }
  }
  EXPECT_GT(base, 100);
  EXPECT_LT(most, 1e-3);
}

TEST(SurfaceCells, ACellsChunkIsAskedWhetherTheGroundOnTopOfItWasDug) {
  Ground ground(1, Vec3::Zero(), make_plane(7.8, {0, 0}));
  SampleWords all;
  all.fill(kAllSoil);
  for (const int x : {-8, 0, 8})
    for (const int y : {-8, 0, 8}) GroundWriter(ground).remove({x, y, 8}, all);
  EXPECT_NEAR(surface_height(ground, 3.2, 3.4).value(), 7.5, 0.15);
}

}  // namespace surface_cells_test
}  // namespace soilvdb::test
