// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Cuts that are too high for the cohesion of the bank, against Culmann's closed form.
#include "core/settle/wall_failure.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "core/constants.h"
#include "core/ground/ground_columns.h"
#include "core/settle/column_samples.h"
#include "core/settle/overhangs.h"
#include "soilvdb/bucket.h"
#include "tests/support/earthmoving_fixture.h"

namespace soilvdb::test {
namespace wall_failure_test {

constexpr double kDegree = std::numbers::pi / 180;

/// Angle between slices of every other direction.
constexpr double kSlices = 22.5 * kDegree;

struct CohesiveSoil {
  double cohesion_pa, friction, weight_n_m3;  // friction in rad

  /// Of a cut that steep with level ground behind it, m (Culmann 1866).
  double critical_height_m(double cut) const {
    return 4 * cohesion_pa / weight_n_m3 * std::sin(cut) * std::cos(friction) /
           (1 - std::cos(cut - friction));
  }
  double plane(double cut) const { return (cut + friction) / 2; }
};

const CohesiveSoil kSoils[] = {{10e3, 30 * kDegree, 18e3},
                               {5e3, 35 * kDegree, 17e3},
                               {20e3, 15 * kDegree, 19e3},
                               {30e3, 0, 18e3},
                               {8e3, 25 * kDegree, 20e3}};

/// A straight cut of a height, rising towards a direction in plan from a line some columns before
/// the middle: means of columns that are one unit wide.
Columns straight_cut(int side, double foot, double direction, double cut, double height) {
  Columns ground(side, side, 1);
  const double rise = std::abs(cut - std::numbers::pi / 2) < 1e-9 ? 1e9 : std::tan(cut);
  constexpr int kPoints = 8;
  for (int x = 0; x < side; ++x) {
    for (int y = 0; y < side; ++y) {
      double sum = 0;
      for (int i = 0; i < kPoints * kPoints; ++i) {
        const double u = x + (i % kPoints + 0.5) / kPoints - side / 2.0;
        const double v = y + (i / kPoints + 0.5) / kPoints - side / 2.0;
        const double way = u * std::cos(direction) + v * std::sin(direction) + foot;
        sum += std::clamp(way * rise, 0.0, height);
      }
      ground.at(ground.index(x, y)) = sum / (kPoints * kPoints);
    }
  }
  ground.firm_m = ground.height_m;
  return ground;
}

/// What fails behind feet in the middle.
WallFailure failure_of(const Columns& ground, const BankStrength& strength, double foot,
                       double direction) {
  const Vec2 middle =
      Vec2::Constant(ground.nx / 2.0) - foot * Vec2(std::cos(direction), std::sin(direction));
  const Coord2 at = middle.cast<int>();
  return find_wedge_failure(ground, {Coord2(at - Coord2(4, 4)), Coord2(at + Coord2(4, 4))},
                            strength, [](int, int) { return 100; });
}

TEST(WallFailure, BeginsAtTheCriticalHeightOfACut) {
  constexpr double kSide = 0.1;
  for (const CohesiveSoil& soil : kSoils) {
    for (const double cut : {90 * kDegree, 75 * kDegree, 60 * kDegree}) {
      const double critical = soil.critical_height_m(cut) / kSide;
      if (critical > 90) continue;
      const BankStrength strength{soil.cohesion_pa / soil.weight_n_m3 / kSide,
                                  std::tan(soil.friction), 1.25};
      for (const double direction : {0.0, 30 * kDegree, 45 * kDegree, 200 * kDegree}) {
        for (const double foot : {20.0, 20.3, 20.7}) {
          const auto fails = [&](double height) {
            const Columns ground = straight_cut(220, foot, direction, cut, height);
            const WallFailure failure = failure_of(ground, strength, foot, direction);
            return !failure.failed.isEmpty();
          };
          EXPECT_FALSE(fails(critical - 1))
              << critical << ' ' << cut / kDegree << ' ' << direction << ' ' << foot;
          EXPECT_TRUE(fails(critical + 1))
              << critical << ' ' << cut / kDegree << ' ' << direction << ' ' << foot;
        }
      }
    }
  }
}

TEST(WallFailure, TakesTheWedgeAboveItsPlane) {
  constexpr double kSide = 0.1;
  for (const CohesiveSoil& soil : kSoils) {
    for (const double cut : {90 * kDegree, 75 * kDegree}) {
      const double height = 1.1 * soil.critical_height_m(cut) / kSide;
      if (height > 90) continue;
      const BankStrength strength{soil.cohesion_pa / soil.weight_n_m3 / kSide,
                                  std::tan(soil.friction), 1.25};
      const double foot = 20;
      const Columns ground = straight_cut(220, foot, 0, cut, height);
      const WallFailure failure = failure_of(ground, strength, foot, 0);
      ASSERT_FALSE(failure.failed.isEmpty());
      // Along the row through the middle.
      const int y = 110;
      double crest = 0, wedge = 0;
      for (int x = 0; x < ground.nx; ++x) {
        const int c = ground.index(x, y);
        const double gone = ground.at(c) - failure.columns[static_cast<std::size_t>(c)].height;
        EXPECT_GE(gone, 0);
        wedge += gone;
        if (gone > 0) crest = x + 0.5 - (110 - foot);
      }
      const double angle = soil.plane(cut), cot = 1 / std::tan(angle);
      EXPECT_NEAR(crest, height * cot, 2) << angle / kDegree;
      EXPECT_NEAR(wedge / (height * height / 2 * (cot - 1 / std::tan(cut))), 1, 0.05);
    }
  }
}

TEST(WallFailure, TakesNoGroundFromBehindWhatStands) {
  std::mt19937 random(53);
  std::uniform_real_distribution<double> share(0, 1);
  constexpr double kFoot = 20;
  for (int n = 0; n < 60; ++n) {
    const CohesiveSoil& soil = kSoils[static_cast<std::size_t>(n) % std::size(kSoils)];
    const double height = 15 + 25 * share(random);
    // Some directions are those of the columns.
    const double direction =
        n % 3 == 0 ? 90 * kDegree * (n / 3) : 2 * std::numbers::pi * share(random);
    const BankStrength strength{
        height / (1.1 * soil.critical_height_m(90 * kDegree)) * soil.cohesion_pa / soil.weight_n_m3,
        std::tan(soil.friction), 1.25};
    const Columns ground = straight_cut(220, kFoot, direction, 90 * kDegree, height);
    const WallFailure failure = failure_of(ground, strength, kFoot, direction);
    ASSERT_FALSE(failure.failed.isEmpty());
    const Vec2 into(std::cos(direction), std::sin(direction)), along(-into.y(), into.x());
    // How far the failure reaches along the cut, at the cut and behind it.
    Eigen::AlignedBox1d front;
    double beyond = 0;
    const auto each_failed = [&](const auto& f) {
      for (int x = 0; x < ground.nx; ++x) {
        for (int y = 0; y < ground.ny; ++y) {
          const int c = ground.index(x, y);
          if (failure.columns[static_cast<std::size_t>(c)].height >= ground.firm_at(c)) continue;
          const Vec2 at = Vec2(x + 0.5, y + 0.5) - Vec2::Constant(110);
          f(at.dot(into) + kFoot, at.dot(along));
        }
      }
    };
    each_failed([&](double way, double aside) {
      if (way < 2) front.extend(Eigen::Matrix<double, 1, 1>(aside));
    });
    each_failed([&](double way, double aside) {
      const double out = std::max(aside - front.max()[0], front.min()[0] - aside);
      const double slices = n % 3 == 0 ? 0.25 : 1;
      beyond = std::max(beyond, out - 1 - way * std::tan(slices * kSlices));
    });
    EXPECT_LE(beyond, 1e-9) << direction / kDegree << ' ' << height;
  }
}

TEST(WallFailure, TakesAWholeRingAroundAPit) {
  std::mt19937 random(54);
  std::uniform_real_distribution<double> share(0, 1);
  for (int n = 0; n < 20; ++n) {
    const CohesiveSoil& soil = kSoils[static_cast<std::size_t>(n) % std::size(kSoils)];
    const double radius = 6 + 24 * share(random), height = 15 + 15 * share(random);
    const Vec2 middle(100 + share(random), 100 + share(random));
    const double critical = soil.critical_height_m(90 * kDegree);
    const BankStrength strength{height / (1.1 * critical) * soil.cohesion_pa / soil.weight_n_m3,
                                std::tan(soil.friction), 1.25};
    const double width = height / std::tan(soil.plane(90 * kDegree));
    Columns ground(200, 200, 1);
    const auto beyond = [&](int x, int y) {  // round pits and square ones
      const Vec2 at = Vec2(x + 0.5, y + 0.5) - middle;
      return n % 2 == 0 ? at.norm() - radius
                        : (at.cwiseAbs() - Vec2::Constant(radius)).cwiseMax(0).norm();
    };
    for (int x = 0; x < 200; ++x)
      for (int y = 0; y < 200; ++y)
        if (beyond(x, y) > 0) ground.at(ground.index(x, y)) = height;
    ground.firm_m = ground.height_m;
    const WallFailure failure = find_wedge_failure(ground, {Coord2(60, 60), Coord2(140, 140)},
                                                   strength, [](int, int) { return 100; });
    int missing = 0, surplus = 0;
    for (int x = 0; x < 200; ++x) {
      for (int y = 0; y < 200; ++y) {
        const int c = ground.index(x, y);
        const bool fails = !failure.columns.empty() &&
                           failure.columns[static_cast<std::size_t>(c)].height < ground.firm_at(c);
        missing += !fails && beyond(x, y) > 0 && beyond(x, y) < 0.9 * width - 2;
        surplus += fails && beyond(x, y) > width + 3;
      }
    }
    EXPECT_EQ(missing, 0) << radius << ' ' << height;
    EXPECT_EQ(surplus, 0) << radius << ' ' << height;
  }
}

TEST(WallFailure, NeverGoesThroughWhatIsRigidOrWasNotDug) {
  const BankStrength strength{2, std::tan(30 * kDegree), 1.25};
  const double height = 60, foot = 20;
  Columns ground = straight_cut(220, foot, 0, 90 * kDegree, height);
  const auto any = [&](const std::function<double(int, int)>& dug) {
    return !find_wedge_failure(ground, {Coord2(80, 106), Coord2(100, 114)}, strength, dug)
                .failed.isEmpty();
  };
  EXPECT_TRUE(any([](int, int) { return 100; }));
  EXPECT_FALSE(any([](int, int) { return 0; }));
  // A wall right behind the crest: no plane comes out.
  ground.rigid.assign(ground.height_m.size(), 0);
  for (int x = 91; x < 220; ++x)
    for (int y = 0; y < 220; ++y) ground.rigid[static_cast<std::size_t>(ground.index(x, y))] = 1;
  EXPECT_FALSE(any([](int, int) { return 100; }));
}

TEST(WallFailure, LeavesACliffThatIsHigherThanPlanesFromASmallCutRise) {
  constexpr double kFoot = 20, kHeight = 40, kCohesion = 5;
  const BankStrength strength{kCohesion, std::tan(35 * kDegree), 1.25};
  ASSERT_LT(4 * kCohesion * std::tan(62.5 * kDegree), kHeight) << "which is critical";
  const Columns ground = straight_cut(220, kFoot, 0, 90 * kDegree, kHeight);
  const Coord2 at(90, 110);
  const auto fails = [&](double dug) {
    return !find_wedge_failure(ground, {Coord2(at - Coord2(4, 4)), Coord2(at + Coord2(4, 4))},
                               strength, [&](int, int) { return dug; })
                .failed.isEmpty();
  };
  // The plane that needs most comes out within 25 columns.
  EXPECT_FALSE(fails(0.9 * kHeight / kMaxPlaneDepths));
  EXPECT_TRUE(fails(1.1 * kHeight / kMaxPlaneDepths));
}

TEST(WallFailure, InAGapBesideACliffEndsAboveTheFoot) {
  constexpr int kSide = 120, kFace = 40, kEnd = 60;
  constexpr double kHeight = 30, kCliff = 200;
  const BankStrength strength{3, std::tan(35 * kDegree), 1.25};
  for (const bool turned : {false, true}) {
    Columns ground(kSide, kSide, 1);
    const auto of = [&](int x, int y) { return ground.index(x, turned ? kSide - 1 - y : y); };
    for (int x = 0; x < kSide; ++x)
      for (int y = 0; y < kSide; ++y)
        ground.at(of(x, y)) = y > kEnd ? -kCliff : x < kFace ? 0 : kHeight;
    ground.firm_m = ground.height_m;
    for (int x = 0; x < kSide; ++x)
      for (int y = kEnd + 1; y < kSide; ++y) ++ground.at(of(x, y));  // what fell before
    const int first = turned ? kSide - 1 - kEnd : 30, last = first + kEnd - 30;
    const WallFailure failure = find_wedge_failure(
        ground, {Coord2(kFace - 2, first), Coord2(kFace, last)}, strength,
        [&](int, int y) { return (turned ? kSide - 1 - y : y) > kEnd ? 0 : 100; });
    double lowest = kHeight;
    for (int x = kFace; !failure.columns.empty() && x < kSide; ++x)
      for (int y = 0; y <= kEnd; ++y)
        lowest = std::min(lowest, failure.columns[static_cast<std::size_t>(of(x, y))].height);
    EXPECT_LT(lowest, kHeight - 1);
    EXPECT_GE(lowest, 0) << turned;
  }
}

TEST(WallFailure, FindsThinWallsTooHeavyForTheirFoot) {
  // 3 sides thick, 20 high: it breaks off along a plane that comes out behind it.
  const BankStrength strength{2, std::tan(30 * kDegree), 1.25};
  Columns ground(80, 80, 1);
  for (int x = 40; x < 43; ++x)
    for (int y = 0; y < 80; ++y) ground.at(ground.index(x, y)) = 20;
  ground.firm_m = ground.height_m;
  const WallFailure failure = find_wedge_failure(ground, {Coord2(30, 38), Coord2(60, 42)}, strength,
                                                 [](int, int) { return 100; });
  ASSERT_FALSE(failure.failed.isEmpty());
  EXPECT_EQ(failure.failed.min().x(), 40);
  EXPECT_EQ(failure.failed.max().x(), 42);
}

/// A trench 2 m wide in x and 12 m long that gets deeper by a voxel with each pass: so that a wall
/// fails all along or not at all.
class Trench {
 public:
  Trench(const CohesiveSoil& with, double voxel_m)
      : ground(voxel_m, Vec3::Zero(), make_plane(0, {0, 0})),
        tracker(ground, {Bucket{12.0, 8.0, {}, {}}}, earthmoving(with)) {}

  static Earthmoving earthmoving(const CohesiveSoil& with) {
    Earthmoving all = loam();
    all.soil->cohesion_pa = with.cohesion_pa;
    all.soil->friction_rad = with.friction;
    all.soil->density_kg_m3 = with.weight_n_m3 / 9.80665;
    return all;
  }
  void pass() {
    depth_m += ground.voxel_size_m();
    for (const Vec3& to :
         {Vec3(-1, 0, 1), Vec3(-1, 0, -depth_m), Vec3(1, 0, -depth_m), Vec3(1, 0, 1)})
      tracker.update(0, {to});
    tracker.come_to_rest();
    EXPECT_EQ(residual(tracker), 0);
  }
  /// How far soil failed beyond a wall, m, halfway along the trench.
  double retreat_m(double side) const {
    const double h = ground.voxel_size_m();
    const int first = -static_cast<int>(10 / h);
    const GroundWindow window(ground, {first, 0}, 1 - 2 * first, 1);
    double retreat = 0;
    for (int x = 0; x < window.nx(); ++x) {
      if (window.at(x, 0).bank < -0.25)
        retreat = std::max(retreat, side * (first + x) * h + h / 2 - 1);
    }
    return retreat;
  }

  /// How far soil stands above the mean of a column of which it fills a part, cells.
  double stands_above() {
    const int first = -static_cast<int>(10 / ground.voxel_size_m());
    double most = 0;
    GroundColumns(ground).each({Coord2(first, -20), Coord2(-first, 20)},
                               [&](const Coord2&, const GroundColumn& column) {
                                 most = std::max(most, column.surface - column.top);
                               });
    return most;
  }

  Ground ground;
  Tracker tracker;
  double depth_m = 0;
};

TEST(WallFailure, BringsDownATrenchDugTooDeep) {
  for (const CohesiveSoil& with : {kSoils[0], kSoils[1]}) {
    Trench trench(with, 0.1);
    const double critical = with.critical_height_m(90 * kDegree);
    double stood = 0;
    while (trench.tracker.mass_balance().slid == 0 && trench.depth_m < critical + 1) {
      stood = trench.stands_above();
      trench.pass();
    }
    EXPECT_NEAR(trench.depth_m, critical, 0.1 + 1e-9);
    EXPECT_GT(stood, 10);  // the walls are in the middle of columns
    // The wall that fails first; what comes down holds the other.
    EXPECT_NEAR(std::max(trench.retreat_m(-1), trench.retreat_m(1)),
                trench.depth_m / std::tan(with.plane(90 * kDegree)), 0.2);
    EXPECT_LT(trench.stands_above(), 2);
    // What is at rest stays.
    const std::uint64_t hash = trench.ground.state_hash();
    trench.tracker.come_to_rest();
    EXPECT_EQ(trench.ground.state_hash(), hash);
  }
}

TEST(WallFailure, BringsDownBothFacesOfAWideCut) {
  // The tool leaves along one of them, right above whose crest it props it no longer.
  for (const double cohesion_pa : {0.0, 1000.0}) {
    SCOPED_TRACE(cohesion_pa);
    Earthmoving all = loam();
    all.soil->cohesion_pa = cohesion_pa;
    Ground ground(0.1, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(ground, {Bucket{8.0, 8.0, {}, {}}}, all);
    for (const Vec3& to : {Vec3(-3, 0, 1), Vec3(-3, 0, -1.4), Vec3(3, 0, -1.4), Vec3(3, 0, 3)})
      tracker.update(0, {to});
    tracker.come_to_rest();
    EXPECT_EQ(residual(tracker), 0);
    const GroundWindow window(ground, {-60, 0}, 121, 1);
    for (const int x : {2, 4, 6}) {  // columns beyond the faces
      const double low = window.at(60 - 30 - x, 0).top, high = window.at(60 + 30 + x, 0).top;
      EXPECT_LT(low, -1) << x;
      EXPECT_NEAR(high, low, 1) << x;
    }
  }
}

TEST(WallFailure, NeedsCohesion) {
  Ground ground(0.1, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {Bucket{2.0, 12.0, {}, {}}}, loam());
  for (const Vec3& to : {Vec3(-6, 0, 1), Vec3(-6, 0, -8), Vec3(6, 0, -8), Vec3(6, 0, 1)})
    tracker.update(0, {to});
  tracker.come_to_rest();
  EXPECT_EQ(tracker.mass_balance().slid, 0);
}

// ---- Overhangs ----

/// Takes all soil out of a box of cells.
void hollow(Ground& ground, const Coord3& low, const Coord3& high) {
  std::vector<ColumnEdit> out;
  for (int x = low.x(); x <= high.x(); ++x)
    for (int y = low.y(); y <= high.y(); ++y)
      out.push_back(ColumnEdit::all({x, y}, low.z(), high.z()));
  remove_top(ground, out, kSlope);
}

class Overhangs : public ::testing::Test {
 protected:
  Overhangs() : ground(0.1, Vec3::Zero(), make_plane(0, {0, 0})) {
    hollow(ground, {-20, -20, -20}, {20, 20, 0});  // a pit 4 m wide, 2 m deep
  }
  std::int64_t fallen(const OverhangStrength* strength) {
    BoundaryContact contact;
    std::int64_t samples = 0;
    for (const UnsupportedPiece& piece :
         find_overhangs(ground, {Coord3(-40, -40, -25), Coord3(40, 40, 2)}, strength, contact)) {
      samples += piece.bank;
      EXPECT_EQ(piece.ground, -21) << piece.cell.transpose();
    }
    EXPECT_FALSE(contact.holds || contact.ground);
    return samples;
  }
  Ground ground;
};

TEST_F(Overhangs, NoneIsThereWithoutHollows) {
  const OverhangStrength none;
  EXPECT_EQ(fallen(&none), 0);
}

TEST_F(Overhangs, StandToTheLengthThatTheirThicknessHolds) {
  // 4 columns deep under one edge of the pit; a slab of 6 cells is left over it, held from behind.
  hollow(ground, {21, -20, -20}, {24, 20, -6});
  hollow(ground, {21, -21, -20}, {24, -21, 0});
  hollow(ground, {21, 21, -20}, {24, 21, 0});
  const std::int64_t slab = 4 * 41 * 64 * 6 - 4 * 41 * 32;  // its top is at half of a cell
  EXPECT_EQ(fallen(nullptr), 0);
  const OverhangStrength no_cohesion{0, 0}, sheared{3.9, 1e9}, holds{4, 1e9};
  EXPECT_EQ(fallen(&no_cohesion), slab);
  EXPECT_EQ(fallen(&sheared), slab);
  EXPECT_EQ(fallen(&holds), 0);
  const double thickness = 5.5;
  const OverhangStrength bent{1e9, 15.9 / thickness}, stiff{1e9, 16.01 / thickness};
  EXPECT_EQ(fallen(&bent), slab);
  EXPECT_EQ(fallen(&stiff), 0);
}

TEST_F(Overhangs, WhatHangsOnNothingFalls) {
  hollow(ground, {21, -20, -20}, {24, 20, -6});
  hollow(ground, {25, -21, -20}, {25, 21, 0});  // cut off behind ...
  EXPECT_EQ(fallen(nullptr), 0);
  hollow(ground, {21, -21, -20}, {24, -21, 0});  // ... and at its ends
  hollow(ground, {21, 21, -20}, {24, 21, 0});
  EXPECT_EQ(fallen(nullptr), 4 * 41 * 64 * 6 - 4 * 41 * 32);
}

}  // namespace wall_failure_test
}  // namespace soilvdb::test
