// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cell/cell_models.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/cell/crease.h"
#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "tests/support/solids.h"

namespace soilvdb::test {
namespace cell_models_test {

TEST(CellModels, FindTheBendsOfASaddleInAnyAttitude) {
  constexpr double kBend = 0.06;  // 1/voxel
  double off = 0, off_across = 0;
  int cells = 0;
  for (int i = 0; i < 12; ++i) {
    const Eigen::Matrix3d turn = from_rpy(0.5 * i, 0.37 * i, 0.9 * i).toRotationMatrix();
    const Vec3 middle = Vec3::Constant(3.4);
    const auto ground = sampled([&](const Vec3& world) {
      const Vec3 p = turn.transpose() * (world - middle);
      return p.z() + kBend * (p.x() * p.x() - p.y() * p.y()) / 2;
    });
    const Coord3 chunk(0, 0, 0);
    const CellGrid grid(*ground, {&chunk, 1}, 1);
    const CellModels models(grid, 1);
    for (const CellModels::Cell& cell : models.cells()) {
      const Vec3 at = (grid.first() + grid.at(cell.id)).cast<double>() - middle;
      if (cell.kind != CellModels::Cell::kSmooth || !cell.has_curvature || at.norm() > 2.5)
        continue;
      const Tangents t(cell.plane);
      const Vec3 u = turn.transpose() * Vec3(t.u[0], t.u[1], t.u[2]);
      const Vec3 v = turn.transpose() * Vec3(t.v[0], t.v[1], t.v[2]);
      const auto truth = [&](const Vec3& a, const Vec3& b) {
        return kBend * (a.x() * b.x() - a.y() * b.y());
      };
      off += std::pow(cell.curvature.uu - truth(u, u), 2) +
             std::pow(cell.curvature.vv - truth(v, v), 2);
      off_across += std::pow(cell.curvature.uv - truth(u, v), 2);
      ++cells;
    }
  }
  ASSERT_GT(cells, 100);
  constexpr double kNoise = 0.08 * kBend;
  EXPECT_LE(std::sqrt(off / (2 * cells)), kNoise);
  EXPECT_LE(std::sqrt(off_across / cells), kNoise / std::numbers::sqrt2);  // mean of two
}

TEST(Crease, IsFoundWhateverTheOrderOfItsPlanes) {
  const Coord3 chunk = Coord3::Zero(), voxel(4, 4, 4);
  for (const BooleanOp op :
       {BooleanOp::kAndAnd, BooleanOp::kOrOr, BooleanOp::kAndOr, BooleanOp::kOrAnd}) {
    CellModel truth;
    truth.op = op;
    for (int p = 0; p < 3; ++p) {
      const Vec3 n = Vec3::Unit(p);
      truth.plane[p] = {float(n.x()), float(n.y()), float(n.z()), 0.1f};
    }
    Ground ground(1, Vec3::Zero(), make_plane(100, {0, 0}));
    SampleWords words{};  // those that are removed
    for (int k = 0; k < kChunkVoxels; ++k) {
      const Coord3 at = numbered_voxel(k), from = at - voxel;
      const CellPoints& p = sample_points(at);
      for (int s = 0; s < 64; ++s) {
        const Vec3 q = from.cast<double>() + Vec3(p.x[s] - 0.5, p.y[s] - 0.5, p.z[s] - 0.5);
        const bool air = truth.at(float(q.x()), float(q.y()), float(q.z())).signed_distance >= 0;
        words[static_cast<std::size_t>(k)] |= std::uint64_t{air} << s;
      }
    }
    GroundWriter(ground).remove(chunk, words);
    const CellGrid grid(ground, {&chunk, 1}, 1);
    std::array<int, 3> order{0, 1, 2};
    do {
      Candidates candidates;
      for (const int p : order) candidates.add(truth.plane[p]);
      const CellModel found = solve_crease(grid, grid.id(12, 12, 12), candidates);
      EXPECT_EQ(found.op, op) << order[0] << order[1] << order[2];
      EXPECT_LE(found.wrong, 1);
    } while (std::next_permutation(order.begin(), order.end()));
  }
}

TEST(Crease, OfAThinWallOrSlotHoldsACentreJustOutsideOfIt) {
  constexpr float kOutside = 0.75f * kThinWallTie;
  for (const float thickness : {0.9f, 1.0f, 1 + 1.75f * kThinWallTie, 2.0f}) {
    CellModel wall, slot;
    wall.op = BooleanOp::kAnd;
    wall.plane[0] = {0, 0, 1, -kOutside};
    wall.plane[1] = {0, 0, -1, thickness + kOutside};
    slot.op = BooleanOp::kOr;
    slot.plane[0] = {0, 0, 1, kOutside};
    slot.plane[1] = {0, 0, -1, -thickness - kOutside};
    EXPECT_EQ(wall.soil(), thickness < 2) << thickness;
    EXPECT_EQ(slot.soil(), thickness >= 2) << thickness;
  }
}

}  // namespace cell_models_test
}  // namespace soilvdb::test
