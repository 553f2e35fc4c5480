// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Sites share one lattice, on which the same dig is the same.
#include "soilvdb/lattice.h"

#include <gtest/gtest.h>

#include "soilvdb/difference.h"
#include "tests/support/difference_fixture.h"

namespace soilvdb {
namespace lattice_test {

TEST(Lattice, IsTheSameWhateverPlaceComesFirst) {
  for (const double h : {0.025, 0.05, 0.1}) {
    const double period = kLatticePeriod * h;
    const Vec3 at(556449.9, 5394951.3, 540);
    const Vec3 origin = lattice_origin(h, at);
    EXPECT_LE((origin - at).cwiseAbs().maxCoeff(), period / 2);
    for (const Vec3& step : {Vec3(30, -40, 5), Vec3(5 * period, 0, 0), Vec3(-2000, 999, -700)}) {
      const auto terrain = plane(0);
      const Ground a(h, origin, terrain), b(h, lattice_origin(h, at + step), terrain);
      const auto shift = lattice_shift(a, b);
      ASSERT_TRUE(shift.has_value());
      EXPECT_LT((a.world_from_index(shift->cast<double>()) - b.origin()).norm(), 1e-6);
      const Coord3 voxel(7, -3, 11);
      EXPECT_EQ(&sample_points(voxel), &sample_points(voxel + *shift));
    }
  }
  const auto terrain = plane(0);
  EXPECT_EQ(lattice_shift({0.1, Vec3::Zero(), terrain}, {0.05, Vec3::Zero(), terrain}),
            std::nullopt);
  for (const double x : {10.0, -10.0}) {
    EXPECT_EQ(lattice_shift({0.1, Vec3::Zero(), terrain}, {0.1, Vec3(x, 0, 0), terrain}),
              std::nullopt);
  }
}

TEST(Lattice, TheSameDigOnOtherOriginsIsTheSame) {
  constexpr double kVoxel = 0.05;
  HalfSine trench;
  trench.from = {556449.9, 5394951};
  trench.yaw = 0.3;
  trench.level = 540;  // samples lie in the ground's plane but for rounding
  const auto terrain = plane(540);
  const Vec3 origin = lattice_origin(kVoxel, {556449.9, 5394951, 540});
  const Vec3 period = Vec3::Constant(kLatticePeriod * kVoxel);
  Ground a(kVoxel, origin, terrain), b(kVoxel, lattice_origin(kVoxel, origin + period), terrain);
  ASSERT_NE(a.origin(), b.origin());
  const Ground before(kVoxel, origin, terrain);
  trench.dig(a);
  trench.dig(b);
  const Difference whole = difference(before, a, true), none = difference(a, b, true);
  EXPECT_GT(whole.cut_m3, 0.2);
  EXPECT_TRUE(none.exact);
  // Samples on the very edge of what the bucket passes may be on either side of it.
  EXPECT_LT(none.cut_m3 + none.fill_m3, 1e-5 * whole.cut_m3);
  EXPECT_NEAR(difference(before, b, true).cut_m3, whole.cut_m3, 1e-5 * whole.cut_m3);
}

}  // namespace lattice_test
}  // namespace soilvdb
