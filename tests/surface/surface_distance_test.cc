// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Distances and heights made from samples, against ground of known shape.
#include "core/surface/surface_distance.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/surface.h"
#include "soilvdb/surface_height.h"
#include "tests/support/dig_runner.h"
#include "tests/support/solids.h"

namespace soilvdb::test {
namespace surface_distance_test {

TEST(SurfaceDistance, IsTheBaseSurfacesOwnWhereNothingWasDug) {
  const Dug dug(make_dig("raster", placements()[1]), 0.05, 50);
  const Ground before(0.05, dug.ground.origin(),
                      {std::shared_ptr<const InitialTerrain>(), &dug.ground.terrain()});
  std::int64_t same = 0;
  for (const Chunk* chunk : dug.ground.chunks()) {
    float phi[kChunkVoxels], base[kChunkVoxels];
    surface_distance(dug.ground, chunk->origin, phi);
    dug.ground.terrain().distance(dug.ground.world_from_index(chunk->origin.cast<double>()), 0.05,
                                  dug.ground.band_m(), base);
    // A chunk of which, and of whose neighbours, no sample was changed.
    bool untouched = true;
    for (int k = 0; k < 27; ++k) {
      const Coord3 c = chunk->origin + kChunkSide * step_around(k);
      SampleWords now, then;
      dug.ground.read_samples(c, now);
      before.read_samples(c, then);
      untouched &= now == then;
    }
    for (int n = 0; n < kChunkVoxels; ++n) {
      if (untouched) {
        ASSERT_EQ(phi[n], base[n]);
      }
      same += phi[n] == base[n] && std::abs(phi[n]) < dug.ground.band_m();
    }
  }
  EXPECT_GT(same, 100);
}

TEST(SurfaceDistance, IsTheTrueDistanceAndTheSameAloneAndInABatch) {
  // The mesh's own error near creases, and what a ball of steps of 0.02 and 300 directions misses.
  constexpr double kError = kVertexError + 0.05;
  for (const Solid& solid : known_solids()) {
    constexpr double h = 0.05;
    const auto ground = sampled(solid, h);
    const std::vector<Coord3> chunks = ground->origins();
    std::vector<std::array<float, kChunkVoxels>> all(chunks.size());
    surface_distances(*ground, chunks, [&](std::size_t i, const float* phi) {
      std::copy_n(phi, kChunkVoxels, all[i].begin());
    });
    int looked = 0, bad = 0;
    std::mt19937 random(1);
    for (std::size_t i = 0; i < chunks.size(); ++i) {
      if (i % 5 == 0) {
        float phi[kChunkVoxels];
        surface_distance(*ground, chunks[i], phi);
        for (std::size_t n = 0; n < kChunkVoxels; ++n) ASSERT_EQ(phi[n], all[i][n]);
      }
      for (int n = 0; n < kChunkVoxels; ++n) {
        const double phi = all[i][static_cast<std::size_t>(n)];
        if (random() % 16 != 0 || std::abs(phi) > 2.5 * h) continue;
        const Vec3 p = h * (chunks[i] + numbered_voxel(n)).cast<double>();
        const double truth = distance_m(solid, p, 0.02 * h);
        bad += std::abs(std::abs(phi) - truth) > kError * h;
        bad += (phi < 0) != (solid.f(p) < 0) && truth > kVertexError * h;
        ++looked;
      }
    }
    EXPECT_GT(looked, 100);
    EXPECT_LE(bad, looked / 50) << solid.name << " of " << looked;
  }
}

TEST(SurfaceHeight, IsThatOfTheHighestTriangleWhereBlocksMeetToo) {
  for (const double yaw : {0.0, 0.3, 0.9}) {
    const Solid trench = half_sine_trench(yaw);
    for (const double h : {0.05, 0.03}) {
      const auto ground = sampled(trench, h);
      const Mesh mesh = mesh_all(*ground);
      SurfaceHeight heights(*ground);
      std::mt19937 random(1);
      std::uniform_real_distribution<double> place(-0.55, 0.55), near(-1, 1);
      for (int k = 0; k < 1500; ++k) {
        Vec2 p(place(random), place(random));
        // Within a voxel of where blocks meet.
        p[k % 2] = h * (kBlockSide * std::round(p[k % 2] / (h * kBlockSide)) + near(random));
        double top = -1e9;
        for (const auto& t : mesh.triangles) {
          Vec3 v[3];
          for (std::size_t c = 0; c < 3; ++c) v[c] = mesh.points[t[c]].cast<double>();
          Eigen::Matrix2d sides;
          sides << (v[1] - v[0]).head<2>(), (v[2] - v[0]).head<2>();
          if (std::abs(sides.determinant()) < 1e-12) continue;
          const Vec2 w = sides.inverse() * (p - v[0].head<2>());
          if (w.minCoeff() < 0 || w.sum() > 1) continue;
          top = std::max(top, v[0].z() + w.x() * (v[1] - v[0]).z() + w.y() * (v[2] - v[0]).z());
        }
        if (top > -1e8) {
          ASSERT_NEAR(*heights.at(p.x(), p.y()), top, 1e-6) << p.transpose() / h;
        }
      }
    }
  }
}

/// Blocks are meshed as places need them, across their borders as well.
TEST(SurfaceHeight, IsThatOfOnePlaceWhateverElseIsAskedFor) {
  constexpr double h = 0.05;
  const auto ground = sampled(half_sine_trench(0.3), h);
  for (int voxel = -3; voxel < 3; ++voxel) {  // of the border at 0
    for (const int axis : {0, 1}) {
      std::array<Vec2, 2> places = {Vec2(0.06, 0.06), Vec2(0.06, 0.06)};
      places[0][axis] = h * (voxel + 0.3);
      places[1][axis] = h * (voxel + 1.3);
      std::array<double, 2> together;
      SurfaceHeight(*ground).at(places, together);
      for (std::size_t i = 0; i < 2; ++i)
        EXPECT_EQ(together[i], surface_height(*ground, places[i].x(), places[i].y()).value())
            << voxel << ", " << axis;
    }
  }
}

TEST(SurfaceDistance, IsTheTrueOneOnAllSidesOfAChunkThatWasDug) {
  Ground ground(1, Vec3::Zero(), make_plane(100, {0, 0}));
  SampleWords all;
  all.fill(kAllSoil);
  GroundWriter(ground).remove(Coord3::Zero(), all);
  for (int n = 0; n < 27; ++n) {
    const Coord3 chunk = kChunkSide * step_around(n);
    float phi[kChunkVoxels];
    surface_distance(ground, chunk, phi);
    for (int k = 0; k < kChunkVoxels; ++k) {
      const Vec3 p = (chunk + numbered_voxel(k)).cast<double>();
      const Vec3 beyond = (p.array() - 3.5).abs() - 4;
      const double most = beyond.maxCoeff(), truth = most < 0 ? -most : -beyond.cwiseMax(0).norm();
      EXPECT_NEAR(phi[k], std::clamp(truth, -ground.band_m(), ground.band_m()), kVertexError)
          << p.transpose();
    }
  }
}

TEST(SurfaceHeight, IsTheBaseSurfacesOutsideAndTheFloorsInside) {
  const Solid box = ground_less("box", {0, 0}, {{Pose{}, Vec3(0.5, 0.4, 0.312)}});
  const auto ground = sampled(box, 0.05);
  EXPECT_EQ(*surface_height(*ground, 5, 5), box.height_m);
  EXPECT_NEAR(*surface_height(*ground, 0.7, 0.1), box.height_m, 1e-6);
  EXPECT_NEAR(*surface_height(*ground, 0.1, 0.1), -0.312, kSmoothError * 0.05 * 3);
}

TEST(SurfaceHeight, IsThatOfTheFloorAcrossTheBordersOfBlocks) {
  const Solid box =
      ground_less("box", {0, 0}, {{{Vec3::Zero(), from_rpy(0, 0, 0.5)}, Vec3(0.8, 0.8, 0.312)}});
  const auto ground = sampled(box, 0.05);
  SurfaceHeight heights(*ground);
  // The floor is flat, also where patches of the mesh meet: every 1.6 m, and a voxel before.
  for (int i = -20; i <= 20; ++i) {
    for (const Vec2& p : {Vec2(0.005 * i, 0.33), Vec2(0.33, 0.005 * i)})
      EXPECT_NEAR(*heights.at(p.x(), p.y()), -0.312, kVertexError * 0.05) << p.transpose();
  }
}

}  // namespace surface_distance_test
}  // namespace soilvdb::test
