// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Laws of the force of soil on a bucket in the ground.
#include "soilvdb/resistance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "soilvdb/session.h"
#include "soilvdb/site.h"
#include "soilvdb/tool_shape.h"
#include "tests/support/allocations.h"

namespace soilvdb::test {
namespace resistance_test {

constexpr double kPi = std::numbers::pi, kDeg = kPi / 180;
const SoilStrength kLoam{18e3 / 9.80665, 10e3, 30 * kDeg, 20 * kDeg, 0};

/// A site, and its heights.
struct Dig {
  std::shared_ptr<Ground> ground;
  Site site;
  HeightMap heights;

  Dig(double voxel_m, std::unique_ptr<InitialTerrain> terrain, const Bucket& bucket,
      const Earthmoving& earthmoving = {})
      : ground(std::make_shared<Ground>(voxel_m, Vec3::Zero(), std::move(terrain))),
        site(ground, {{{"digger", bucket, {}}}, earthmoving}),
        heights(*ground) {}
  void to(const Vec3& position, const Eigen::Quaterniond& rotation) {
    const StepResult step = site.update({.machine = 0, .pose = {position, rotation}});
    ASSERT_TRUE(step.ok()) << step.why;
  }
  Resistance resistance(const SoilStrength& soil = kLoam, bool crescents = false) {
    return site.cut_geometry(0, heights).resistance(soil, crescents);
  }
};

/// A blade without a body, which leans back by its rake.
Bucket blade(double width_m = 1.2) { return {width_m, 1.0, {}, {}, {}}; }
Eigen::Quaterniond lean(double rake_deg, double yaw = 0) {
  return from_rpy(0, (rake_deg - 90) * kDeg, yaw);
}
/// A bucket whose floor rises behind the lip.
Bucket bucket() {
  return {1.2, 0.9, {{0, 0}, {-0.5, 0.1}, {-0.85, 0.4}, {-0.6, 0.9}, {0, 0.9}}, {}, {}};
}

constexpr int kPosts = 101;
constexpr double kPostSpacing_m = 0.1;

/// Ground with a bend every 0.1 m, 10 m wide, about (0, 0).
struct Field : HeightSource {
  std::function<double(double, double)> z;

  void read(int x0, int y0, int nx, int ny, float* out) const override {
    const auto at = [](int post) { return kPostSpacing_m * (post - kPosts / 2); };
    for (int i = y0; i < y0 + ny; ++i)
      for (int j = x0; j < x0 + nx; ++j) *out++ = static_cast<float>(z(at(j), at(i)));
  }
};
std::unique_ptr<InitialTerrain> field(std::function<double(double, double)> z) {
  const auto source = std::make_shared<Field>();
  source->z = std::move(z);
  const Vec2 first = Vec2::Constant(-kPostSpacing_m * (kPosts / 2));
  return make_height_field({kPosts, kPosts, first, Vec2::Constant(kPostSpacing_m)}, source);
}

Wrench in_world(const Resistance& r, const Eigen::Quaterniond& rotation) {
  return turned(r.total(), rotation);
}

/// The formula's force on a blade of this width: a search over 20 001 angles on exact geometry.
TEST(Resistance, OfABladeIsThatOfTheFormulaAtAnyVoxelSize) {
  struct Case {
    double rake, slope_deg, width, ahead, up, moment, angle_deg;
    bool crescents;
  };
  for (const Case& c : std::vector<Case>{{60, 0, 1.2, 10296.96, 1815.63, 1563.33, 34.045, false},
                                         {60, 15, 1.2, 14955.91, 2637.13, 1980.11, 42.363, false},
                                         {60, -15, 1.2, 7327.03, 1291.95, 1309.61, 24.833, false},
                                         {60, 0, 1.2, 14652.55, 2583.64, 2236.30, 38.628, true},
                                         {60, 0, 0.3, 26659.96, 4700.87, 4096.35, 42.728, true}}) {
    for (const double voxel_m : {0.1, 0.05, 0.025}) {
      SCOPED_TRACE(testing::Message() << c.rake << " " << c.slope_deg << " " << voxel_m);
      Dig dig(voxel_m, make_plane(0.3, {std::tan(c.slope_deg * kDeg), 0}), blade(c.width));
      for (const double x : {-0.6, -0.3, 0.}) dig.to({x, 0, 0}, lean(c.rake));
      const Resistance r = dig.resistance(kLoam, c.crescents);
      const Wrench cut = turned(r.cut, lean(c.rake));
      const double bound = (voxel_m > 0.04 ? 5e-3 : 1e-3) * c.ahead * c.width;
      EXPECT_NEAR(cut.force.x(), -c.ahead * c.width, bound);
      EXPECT_NEAR(cut.force.y(), 0, bound);
      EXPECT_NEAR(cut.force.z(), -c.up * c.width, bound);
      EXPECT_NEAR(cut.moment.y(), -c.moment * c.width, bound);
      EXPECT_NEAR(r.depth_m, 0.3, 1e-3);
      EXPECT_NEAR(r.angle_rad / kDeg, c.angle_deg, 0.1);
      EXPECT_FALSE(r.steep || r.open || r.pressed);
    }
  }
}

TEST(Resistance, OfABucketIsTheSameAtAnyYawAndAfterAnyNumberOfUpdates) {
  const auto force = [&](double yaw, int updates) {
    Dig dig(0.05, make_plane(0.02, {0.1 * std::cos(yaw), 0.1 * std::sin(yaw)}), bucket());
    const Eigen::Quaterniond q = from_rpy(0, 0.3, yaw);
    const Vec3 way = Vec3(std::cos(yaw), std::sin(yaw), 0);
    dig.to(-1.2 * way + Vec3(0, 0, 0.5), q);
    dig.to(-0.8 * way + Vec3(0, 0, -0.3), q);
    for (int i = 1; i <= updates; ++i)
      dig.to((-0.8 + 0.8 * i / updates) * way - Vec3(0, 0, 0.3), q);
    return dig.resistance();
  };
  const Resistance one = force(0, 20);
  EXPECT_LT(one.cut.force.x(), -3000);
  EXPECT_EQ(one.total().force.y(), 0);
  for (const int updates : {5, 1000}) {
    const Wrench all = force(0, updates).total();
    EXPECT_LT((all.force - one.total().force).norm(), 1e-3 * one.total().force.norm());
  }
  for (const double yaw : {0.3, 0.8, kPi / 2, 2.0, kPi, -1.1}) {
    const Resistance other = force(yaw, 20);
    EXPECT_LT((other.cut.force - one.cut.force).norm(), 0.01 * one.cut.force.norm()) << yaw;
    EXPECT_LT((other.total().force - one.total().force).norm(), 0.01 * one.total().force.norm());
  }
}

TEST(Resistance, IsMirroredWithTheGround) {
  const auto force = [](double side) {
    Dig dig(0.05, field([=](double x, double y) {
              return 0.3 + 0.2 * std::exp(-2 * (x - 1) * (x - 1)) * std::max(0.0, side * y);
            }),
            blade());
    for (const double x : {-0.6, 0.}) dig.to({x, 0, 0}, lean(60));
    return dig.resistance().total();
  };
  const Wrench left = force(1), right = force(-1);
  EXPECT_GT(std::abs(left.moment.z()), 10);
  EXPECT_NEAR(left.force.x(), right.force.x(), 1e-3 * std::abs(left.force.x()));
  EXPECT_NEAR(left.force.z(), right.force.z(), 1e-3 * std::abs(left.force.z()));
  EXPECT_NEAR(left.moment.z(), -right.moment.z(), 0.02 * std::abs(left.moment.z()));
  EXPECT_NEAR(left.moment.x(), -right.moment.x(), 0.02 * std::abs(left.moment.x()));
}

/// Force ahead and up of the formula, per metre of a blade at 60 degrees and 0.3 m deep in loam of
/// level ground, with soil beside on one of its sides; and the part of that side.
struct OneSided {
  double ahead, up, side_ahead, side_up;

  explicit OneSided(double width) {
    constexpr double kDepth = 0.3, kRake = 60 * kDeg, kFriction = 30 * kDeg, kTool = 20 * kDeg;
    const auto cotangent = [](double angle) { return 1 / std::tan(angle); };
    double least = 1e9, side = 0;
    for (int n = 1; n < 70000; ++n) {
      const double beta = n * 1e-3 * kDeg;
      const double area = kDepth * kDepth * (cotangent(kRake) + cotangent(beta)) / 2;
      const double radius = kDepth * std::sqrt(cotangent(beta) * cotangent(beta) +
                                               2 * cotangent(kRake) * cotangent(beta));
      const double weight = 18e3 * area * std::sin(beta + kFriction),
                   plane = 10e3 * kDepth / std::sin(beta) * std::cos(kFriction);
      const double by = std::sin(kRake + beta + kTool + kFriction);
      const double beside = (weight * radius / (3 * width) + plane * radius / (2 * width)) / by;
      const double p = (weight + plane) / by + beside;
      if (p >= least) continue;
      least = p;
      side = beside;
    }
    const double along = std::sin(kRake + kTool), upward = std::cos(kRake + kTool);
    ahead = least * along;
    up = least * upward;
    side_ahead = side * along;
    side_up = side * upward;
  }
};

/// Beside the blade there is a wall of a slot, or a trench, or ground like that ahead.
TEST(Resistance, OfSoilBesideTheBladeActsAtItsCorner) {
  constexpr double kWidth = 1.2;
  const OneSided formula(kWidth);
  const auto force = [](double left, double right, double yaw, double rake = 60) {
    Dig dig(0.05, field([=](double x, double y) {
              const double across = std::cos(yaw) * y - std::sin(yaw) * x;
              return across > 0.65 ? left : across < -0.65 ? right : 0.3;
            }),
            blade(kWidth));
    const Vec3 way(std::cos(yaw), std::sin(yaw), 0);
    for (const double x : {-0.6, 0.}) dig.to(x * way, lean(rake, yaw));
    return turned(dig.resistance(kLoam, true).cut, lean(rake));  // with the blade's yaw
  };
  const double moment = formula.side_ahead * kWidth * kWidth / 2,
               roll = formula.side_up * kWidth * kWidth / 2;
  for (const double yaw : {0., kPi / 2, kPi}) {
    for (const double closed : {1.5, -0.4}) {
      SCOPED_TRACE(testing::Message() << yaw << " " << closed);
      const Wrench left = force(0.3, closed, yaw), right = force(closed, 0.3, yaw);
      EXPECT_NEAR(left.force.x(), -formula.ahead * kWidth, 1e-3 * formula.ahead);
      EXPECT_NEAR(left.force.z(), -formula.up * kWidth, 1e-3 * formula.ahead);
      EXPECT_NEAR(left.moment.z(), moment, 1e-3 * moment);  // what is at the left turns it left
      EXPECT_NEAR(left.moment.x(), -roll, 1e-3 * moment);
      EXPECT_NEAR(right.moment.z(), -moment, 1e-3 * moment);
      EXPECT_NEAR(right.moment.x(), roll, 1e-3 * moment);
      EXPECT_NEAR(right.force.x(), left.force.x(), 1e-9 * formula.ahead);
    }
    EXPECT_NEAR(force(0.3, 0.3, yaw).moment.z(), 0, 1e-9 * moment);
    EXPECT_NEAR(force(1.5, -0.4, yaw).moment.z(), 0, 1e-9 * moment);
    EXPECT_GT(force(0.3, 1.5, yaw, 95).moment.z(), moment);  // with a body of soil
  }
}

TEST(Resistance, GrowsByAHeapAheadAndShrinksByADrop) {
  const auto force = [](const std::function<double(double)>& z) {
    Dig dig(0.025, field([&](double x, double) { return z(x); }), blade());
    for (const double x : {-0.6, 0.}) dig.to({x, 0, 0}, lean(60));
    return -in_world(dig.resistance(), lean(60)).force.x() / 1.2;
  };
  EXPECT_NEAR(force([](double) { return 0.3; }), 10297, 10);
  EXPECT_NEAR(force([](double x) { return 0.3 + std::max(0.0, 0.2 - std::abs(x - 0.6) / 2); }),
              14314.06, 0.005 * 14314.06);
  EXPECT_LT(force([](double x) { return x < 0.35 ? 0.3 : 0.05; }), 5500);
}

TEST(Resistance, IsOnlyTheLoadWhereTheBucketLeaves) {
  const SoilStrength sand{1800, 0, 0.6, 0.4, 0};
  Earthmoving soil;
  soil.soil = SoilProperties{};
  soil.soil->repose_rad = 0.6;
  soil.soil->swell = 0.25;
  Dig dig(0.05, make_plane(0, {0, 0}), bucket(), soil);
  for (const Vec3& p : {Vec3(-1.5, 0, 0.6), Vec3(-1.2, 0, -0.3), Vec3(0, 0, -0.3)})
    dig.to(p, from_rpy(0, 0.2, 0));
  EXPECT_LT(dig.resistance(sand).cut.force.x(), -300);
  dig.to({-0.05, 0, -0.25}, from_rpy(0, 0.2, 0));
  Resistance r = dig.resistance(sand);
  EXPECT_EQ(r.cut.force, Vec3::Zero());
  dig.to({-0.05, 0, -0.2}, from_rpy(0, 0.2, 0));  // straight up
  r = dig.resistance(sand);
  EXPECT_EQ(r.cut.force, Vec3::Zero());
  EXPECT_EQ(r.cut.moment, Vec3::Zero());
  const Ledger& ledger = dig.site.tracker().ledger(0);
  const double kg = ledger.units.kg(ledger.load, ledger.sample_m3, *soil.soil);
  ASSERT_GT(kg, 100);
  const Wrench world = turned(r.load, from_rpy(0, 0.2, 0));
  EXPECT_NEAR(world.force.z(), -9.80665 * kg, 1e-6 * kg);
  EXPECT_NEAR(world.force.head<2>().norm(), 0, 1e-6);
  // It lies in the bucket, behind the lip.
  EXPECT_LT(world.moment.y(), -0.1 * 9.8 * kg);
  EXPECT_GT(world.moment.y(), -0.85 * 9.8 * kg);
}

TEST(Resistance, OfTheDirectionOfTheLastUpdateStaysInClonesAndStates) {
  Dig dig(0.05, make_plane(0.3, {0, 0}), blade());
  for (const double x : {-0.6, 0.}) dig.to({x, 0, 0}, lean(60));
  const Vec3 ahead = dig.site.direction(0);
  EXPECT_EQ(ahead, Vec3::UnitX());
  dig.to({0, 0, 0}, lean(60));  // stands
  EXPECT_EQ(dig.site.direction(0), ahead);
  const std::string bytes = dig.site.progress();
  Site clone(dig.site);
  EXPECT_EQ(clone.direction(0), ahead);
  dig.to({-0.1, 0, 0.1}, lean(60));
  EXPECT_LT(dig.site.direction(0).x(), 0);
  EXPECT_EQ(dig.resistance().cut.force, Vec3::Zero());
  dig.site.set_progress(bytes);
  EXPECT_EQ(dig.site.direction(0), ahead);
  EXPECT_THROW(dig.site.set_progress(std::string_view(bytes).substr(0, bytes.size() - 8)),
               std::invalid_argument);
  ASSERT_TRUE(dig.site.place({.machine = 0, .pose = {{0, 0, 3}, lean(60)}}).ok());
  EXPECT_EQ(dig.site.direction(0), Vec3::Zero());
}

/// Lip and ground are rolled alike. In an upright slice the blade is then steeper, and the lip is
/// as wide as its plan.
TEST(Resistance, OfARolledBladeIsThatOfItsUprightSlice) {
  const double roll = 0.4, rake = 55 * kDeg, steeper = std::atan(std::tan(rake) / std::cos(roll));
  const auto force = [](double roll_rad, double rake_rad, double width_m) {
    Dig dig(0.05, make_plane(0.3, {0, std::tan(roll_rad)}), blade(width_m));
    const Eigen::Quaterniond turn = Eigen::AngleAxisd(roll_rad, Vec3::UnitX()) *
                                    Eigen::AngleAxisd(rake_rad - kPi / 2, Vec3::UnitY());
    const CutGeometry cut(dig.heights, *dig.ground, blade(width_m), {Vec3::Zero(), turn},
                          Vec3::UnitX(), 0);
    return in_world(cut.resistance(kLoam, false), turn).force;
  };
  const Vec3 rolled = force(roll, rake, 1.2), level = force(0, steeper, 1.2 * std::cos(roll));
  EXPECT_LT((rolled - level).norm(), 1e-3 * level.norm());
  // Where only one corner is deep, the ground before that is looked at.
  Dig dig(0.05, make_plane(0, {0, 0}), blade(4));
  const CutGeometry cut(dig.heights, *dig.ground, blade(4),
                        {Vec3(0, 0, -0.05), from_rpy(0.3, -0.5, 0)}, Vec3::UnitX(), 0);
  const Resistance r = cut.resistance(kLoam, false);
  EXPECT_LT(r.cut.force.x(), 0);
  EXPECT_FALSE(r.open);
}

/// The lip presses as it goes into the soil along the blade: with all of its force from a sine of
/// 0.17 on. Side plates do as they go ahead, at half their length in the soil.
TEST(Resistance, OfBluntEdgesIsByTheirWay) {
  Bucket blunt = blade();
  blunt.edge_m = 0.02;
  Dig dig(0.05, make_plane(0.3, {0, 0}), blunt);
  const Pose there{Vec3::Zero(), lean(60)};
  const auto edge = [&](double rise_deg) {
    const Vec3 way(std::cos(rise_deg * kDeg), 0, std::sin(rise_deg * kDeg));
    const CutGeometry cut(dig.heights, *dig.ground, blunt, there, way, 0);
    return Vec3(-turned(cut.resistance(kLoam, false).edge, lean(60)).force / 9715);
  };
  for (const double rise_deg : {-40., 0., 25., 28., 35.}) {
    const double share = std::clamp(std::cos((60 + rise_deg) * kDeg) / 0.17, 0.0, 1.0);
    const Vec3 way(std::cos(rise_deg * kDeg), 0, std::sin(rise_deg * kDeg));
    EXPECT_LT((edge(rise_deg) - share * way).norm(), 1e-3) << rise_deg;
  }
  for (const double aside_deg : {60., -75.}) {  // along itself it doesn't press
    const Vec3 way(std::cos(aside_deg * kDeg), std::sin(aside_deg * kDeg), 0);
    const CutGeometry cut(dig.heights, *dig.ground, blunt, there, way, 0);
    const Vec3 force = turned(cut.resistance(kLoam, false).edge, lean(60)).force;
    EXPECT_NEAR(force.y(), 0, 1e-6);
    EXPECT_LT(force.x(), 0);
  }
  // As much of its thickness as is below the ground: it stands at right angles to the blade.
  for (const double deep : {0.001, 0.004, 0.012, 0.05}) {
    const double thick = std::min(0.02, deep / std::cos(60 * kDeg));
    const double pressure = 10e3 * 30.140 + 18e3 * (deep * 18.401 + thick * 22.402 / 2);
    const CutGeometry cut(dig.heights, *dig.ground, blunt, {Vec3(0, 0, 0.3 - deep), lean(60)},
                          Vec3::UnitX(), 0);
    const double force = cut.resistance(kLoam, false).edge.force.norm();
    EXPECT_NEAR(force, pressure * thick * 1.2, 1e-3 * force) << deep;
  }
  Bucket plates = bucket();
  plates.plate_m = 0.03;
  const CutGeometry cut(dig.heights, *dig.ground, plates, {Vec3::Zero(), from_rpy(0, 0, 0)},
                        Vec3::UnitX(), 0);
  const Wrench edges = cut.resistance(kLoam, false).edge;
  const double pressure = 10e3 * 30.140 + 18e3 * (0.15 * 18.401 + 0.03 * 22.402 / 2);
  EXPECT_NEAR(edges.force.x(), -pressure * 2 * 0.03 * 0.3, 5);
  EXPECT_NEAR(edges.moment.y(), 0.15 * edges.force.x(), 1e-6 * pressure);
  const CutGeometry swung(dig.heights, *dig.ground, plates, {Vec3::Zero(), from_rpy(0, 0, 0)},
                          Vec3(0.5, 0.6, 0.3), 0);
  EXPECT_LT((swung.resistance(kLoam, false).edge.force - edges.force).norm(), 1e-9 * pressure);
}

/// Side plates that reach above the ground keep soil beside them out.
TEST(Resistance, OfABucketWithPlatesHasNoCrescents) {
  Dig dig(0.05, make_plane(0.3, {0, 0}), bucket());
  const auto force = [&](const Bucket& of, bool crescents) {
    const CutGeometry cut(dig.heights, *dig.ground, of, {Vec3::Zero(), from_rpy(0, 0.3, 0)},
                          Vec3::UnitX(), 0);
    return cut.resistance(kLoam, crescents).cut.force;
  };
  EXPECT_EQ(force(bucket(), true), force(bucket(), false));
  Bucket low = bucket();
  low.height_m = 0.1;
  EXPECT_LT(force(low, true).x(), 1.1 * force(low, false).x());
}

/// A load smaller than the wedge's part above the blade is all counted there.
TEST(Resistance, NeverLiftsTheBucketByItsLoad) {
  Dig dig(0.05, make_plane(0.3, {0, 0}), blade());
  const auto load = [&](double load_m3) {
    const CutGeometry cut(dig.heights, *dig.ground, blade(), {Vec3::Zero(), lean(45)},
                          Vec3::UnitX(), load_m3);
    return in_world(cut.resistance(kLoam, false), lean(45)).force.z() -
           turned(cut.resistance(kLoam, false).cut, lean(45)).force.z();
  };
  const double above = 1.2 * 0.3 * 0.3 / 2;
  EXPECT_NEAR(load(above / 10), 0, 1e-6);
  EXPECT_NEAR(load(above * 2), -18e3 * above, 0.02 * 18e3 * above);
}

/// A body without a heel's face that looks down presses by whichever looks along the way: when the
/// curled bucket tamps, and when it drags back. No attitude is skipped.
TEST(Resistance, PressesWhicheverWayTheLipGoes) {
  double before = 0;
  for (double pitch = -0.05; pitch > -0.9; pitch -= 0.05) {
    SCOPED_TRACE(pitch);
    Dig dig(0.05, make_plane(0, {0, 0}), bucket());
    for (const double z : {0.4, -0.1}) dig.to({0, 0, z}, from_rpy(0, pitch, 0));
    const Resistance tamps = dig.resistance();
    EXPECT_TRUE(tamps.pressed);
    const double up = (from_rpy(0, pitch, 0) * tamps.heel.force).z();
    EXPECT_GT(up, 20e3);
    if (before > 0) {
      EXPECT_GT(up, 0.5 * before);
      EXPECT_LT(up, 2 * before);
    }
    before = up;
  }
  Dig dig(0.05, make_plane(0, {0, 0}), bucket());
  for (const Vec3& at : {Vec3(0, 0, 0.4), Vec3(0, 0, -0.1), Vec3(-0.05, 0, -0.11)})
    dig.to(at, from_rpy(0, -0.3, 0));
  const Resistance back = dig.resistance();
  EXPECT_GT((from_rpy(0, -0.3, 0) * back.heel.force).x(), 1e3);
  EXPECT_EQ(back.limited(), "heel");
  // In the ground that nobody dug yet, but not along what its own way has cleared.
  for (double x = -0.1; x > -0.5; x -= 0.05) {
    dig.to({x, 0, -0.11}, from_rpy(0, -0.3, 0));
    EXPECT_TRUE(dig.resistance().pressed) << x;
  }
  // Back along the floor that it has just made, in voxels of which walls are in the next column.
  for (const double voxel_m : {0.025, 0.05, 0.1}) {
    SCOPED_TRACE(voxel_m);
    Dig flat(voxel_m, make_plane(0, {0, 0}), bucket());
    for (double x = 0; x < 2; x += 0.05)
      flat.to({x, 0, 0.1 - std::min(0.3, 0.4 * x)}, from_rpy(0, 0.1, 0));
    EXPECT_LT(flat.resistance().cut.force.x(), -2000);
    flat.to({1.93, 0, -0.2}, from_rpy(0, 0.1, 0));
    EXPECT_EQ(flat.resistance().heel.force, Vec3::Zero());
  }
  dig.to({-0.3, 0, -0.11}, from_rpy(0, -0.3, 0));
  for (double x = -0.35; x > -0.45; x -= 0.02) {
    dig.to({x, 0, -0.105}, from_rpy(0, -0.3, 0));
    EXPECT_FALSE(dig.resistance().pressed) << x;
  }
}

/// The way up that soil fails is the bound, and how deep the blade's end is.
TEST(Resistance, SaysWhereTheFormulaIsABound) {
  const auto limited = [](const Vec3& way, double depth_m, const Bucket& of) {
    Dig dig(0.05, make_plane(depth_m, {0, 0}), of);
    const CutGeometry cut(dig.heights, *dig.ground, of, {Vec3::Zero(), lean(60)}, way, 0);
    return cut.resistance(kLoam, false).limited();
  };
  // In loam before this blade soil fails at 34 degrees.
  for (const auto& [deg, expected] :
       {std::pair(0., ""), std::pair(33., ""), std::pair(35., "lifts"), std::pair(60., "lifts")})
    EXPECT_EQ(limited({std::cos(deg * kDeg), 0, std::sin(deg * kDeg)}, 0.3, blade()), expected)
        << deg;
  Bucket low = blade();
  low.height_m = 0.3 / std::sin(60 * kDeg);
  EXPECT_EQ(limited(Vec3::UnitX(), 0.29, low), "");
  EXPECT_EQ(limited(Vec3::UnitX(), 0.36, low), "blade below ground");
  // By any strip.
  for (const double side : {-0.2, 0.2}) {
    Dig dig(0.05, make_plane(0.3, {0, side}), low);
    const CutGeometry cut(dig.heights, *dig.ground, low, {Vec3::Zero(), lean(60)}, Vec3::UnitX(),
                          0);
    EXPECT_EQ(cut.resistance(kLoam, false).limited(), "blade below ground");
  }
}

/// In a box whose floor is level, loose soil lies as deep as its volume says.
TEST(Resistance, LooseSoilOfTheLoadIsWhereItLies) {
  const Bucket box{1, 1, {{0, 0}, {-1, 0}, {-1, 1}, {0, 1}}, {}, {}};
  Dig dig(0.05, make_plane(-5, {0, 0}), box);
  for (const double swell : {0., 0.25, 0.5}) {
    const CutGeometry cut(dig.heights, *dig.ground, box, {Vec3::Zero(), from_rpy(0, -0.4, 0)},
                          Vec3::UnitX(), 0.3, swell);
    const Resistance r = cut.resistance(kLoam);
    const Vec3 down = from_rpy(0, -0.4, 0).conjugate() * -Vec3::UnitZ();
    // The centroid of the part of the square below a level line, by Monte Carlo.
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> unit(0, 1);
    std::vector<Eigen::Vector2d> all(200000);
    for (Eigen::Vector2d& p : all) p = {-unit(random), unit(random)};
    std::sort(all.begin(), all.end(), [&](const auto& a, const auto& b) {
      return a.x() * down.x() + a.y() * down.z() > b.x() * down.x() + b.y() * down.z();
    });
    const auto count = static_cast<std::size_t>(0.3 * (1 + swell) * 200000);
    Eigen::Vector2d centre(0, 0);
    for (std::size_t i = 0; i < count; ++i) centre += all[i] / static_cast<double>(count);
    const Vec3 weight = 0.3 * 18e3 * down;
    EXPECT_NEAR(r.load.moment.y(), Vec3(centre.x(), 0, centre.y()).cross(weight).y(), 10) << swell;
    EXPECT_NEAR((r.load.force - weight).norm(), 0, 1e-6);
  }
}

/// Pressure on a blunt edge of 20 mm at a depth of 0.3 m: 4413, 9715, 15 592, 26 867 N.
TEST(Resistance, OfABluntEdgeIsItsBearingCapacity) {
  for (const auto& [friction_deg, expected] : {std::pair(20., 4413.), std::pair(30., 9715.),
                                               std::pair(35., 15592.), std::pair(40., 26867.)}) {
    Bucket blunt = blade();
    blunt.edge_m = 0.02;
    Dig dig(0.05, make_plane(0.3, {0, 0}), blunt);
    for (const double x : {-0.6, 0.}) dig.to({x, 0, 0}, lean(60));
    SoilStrength soil = kLoam;
    soil.friction_rad = friction_deg * kDeg;
    const Wrench edge = turned(dig.resistance(soil).edge, lean(60));
    EXPECT_NEAR(edge.force.x(), -expected, 1);
    EXPECT_NEAR(edge.force.z(), 0, 1e-6);
  }
}

TEST(Resistance, PressesOnAFloorThatDescendsBackwards) {
  Bucket low = bucket();
  low.profile[1] = {-0.5, -0.1};
  const auto at = [&](double pitch) {
    Dig dig(0.05, make_plane(0, {0, 0}), low);
    for (const double x : {-1., 0.}) dig.to({x, 0, -0.3}, from_rpy(0, pitch, 0));
    return dig.resistance();
  };
  const Resistance heel = at(0);
  EXPECT_TRUE(heel.pressed);
  // At right angles to the floor, and along it against the way by the tool's friction.
  const Vec3 out = Vec3(0.1, 0, -0.5).normalized(), along = Vec3(0.5, 0, 0.1).normalized();
  const double pressed = -heel.heel.force.dot(out), rubbed = -heel.heel.force.dot(along);
  EXPECT_NEAR(rubbed, std::tan(kLoam.tool_friction_rad) * pressed, 1e-6 * pressed);
  EXPECT_NEAR(heel.heel.force.y(), 0, 1e-6 * pressed);
  EXPECT_EQ(heel.cut.force, Vec3::Zero());
  // A footing as long as the floor, at its mean depth.
  const double length = std::hypot(0.5, 0.1);
  const double pressure = 10e3 * 30.140 + 18e3 * (0.35 * 18.401 + length * 22.402 / 2);
  EXPECT_NEAR(pressed, pressure * 1.2 * length, 0.02 * pressure * 1.2 * length);
  // One that is narrower than long is as wide as the bucket.
  Bucket narrow = low;
  narrow.width_m = 0.3;
  Dig slot(0.05, make_plane(0, {0, 0}), narrow);
  for (const double x : {-1., 0.}) slot.to({x, 0, -0.3}, from_rpy(0, 0, 0));
  const double of_width = 10e3 * 30.140 + 18e3 * (0.35 * 18.401 + 0.3 * 22.402 / 2);
  EXPECT_NEAR(-slot.resistance().heel.force.dot(out), of_width * 0.3 * length,
              0.02 * of_width * 0.3 * length);
  // Nearly straight into the floor little rubs.
  for (const double aside : {0.05, 0.1}) {
    const CutGeometry into(slot.heights, *slot.ground, narrow,
                           {Vec3(0, 0, -0.3), from_rpy(0, 0, 0)}, out + aside * along, 0);
    const Vec3 force = into.resistance(kLoam).heel.force;
    const double share = aside / std::hypot(1, aside) / 0.17;
    EXPECT_NEAR(-force.dot(along), -share * std::tan(kLoam.tool_friction_rad) * force.dot(out),
                1e-6 * force.norm());
    EXPECT_LT(force.dot(out), 0);
    // Derivatives by the tool's friction.
    SoilStrength more = kLoam, less = kLoam;
    more.tool_friction_rad += 1e-5;
    less.tool_friction_rad -= 1e-5;
    const Vec3 by =
        (into.resistance(more).total().force - into.resistance(less).total().force) / 2e-5;
    EXPECT_LT((into.resistance(kLoam).by_strength.col(3) - by).norm(), 1e-6 * force.norm());
  }
  Dig whole(0.05, make_plane(0, {0, 0}), low);  // not dug
  const CutGeometry cut(whole.heights, *whole.ground, low, {Vec3(0, 0, -0.3), from_rpy(0, 0, 0)},
                        Vec3::UnitX(), 0);
  EXPECT_FALSE(cut.resistance(kLoam).pressed);
  EXPECT_FALSE(at(0.4).pressed);
}

/// The part of the wedge above the blade, d^2 cot(rake) / 2, lies near the lip; the rest of the
/// load farther back than the whole.
TEST(Resistance, CountsSoilAboveTheBladeOnce) {
  Bucket deep = bucket();
  deep.profile[1] = {-0.5, 0.35};
  const auto at = [&](double z) {
    Dig dig(0.05, make_plane(0, {0, 0}), deep);
    for (int i = 0; i <= 20; ++i) dig.to({-2 + 0.1 * i, 0, z}, from_rpy(0, 0.1, 0));
    const Resistance r = dig.resistance();
    const Ledger& ledger = dig.site.tracker().ledger(0);
    const double whole = static_cast<double>(ledger.load) * ledger.sample_m3;
    return std::pair(turned(r.load, from_rpy(0, 0.1, 0)), whole * 18e3);
  };
  const auto [load, whole_n] = at(-0.2);
  const double rake = std::atan2(0.35, 0.5) + 0.1;
  const double above_n = 18e3 * 1.2 * 0.2 * 0.2 / std::tan(rake) / 2;
  ASSERT_GT(whole_n, 3 * above_n);
  EXPECT_NEAR(load.force.z(), -(whole_n - above_n), 0.02 * above_n);
  const double arm = 0.2 / std::tan(rake) / 3;  // of its centroid
  EXPECT_GT(-load.moment.y() / (whole_n - above_n), arm);
}

TEST(Resistance, HasExactDerivatives) {
  Bucket blunt = bucket();
  blunt.edge_m = 0.02;
  blunt.plate_m = 0.03;
  Dig dig(0.05, make_plane(0, {0.1, 0.05}), blunt);
  for (const double x : {-1., 0.}) dig.to({x, 0, -0.3}, from_rpy(0, 0.5, 0));
  SoilStrength soil{1750, 8000, 0.5, 0.3, 500};
  const Resistance r = dig.resistance(soil);
  double* const members[] = {&soil.density_kg_m3, &soil.cohesion_pa, &soil.friction_rad,
                             &soil.tool_friction_rad, &soil.adhesion_pa};
  for (int k = 0; k < 5; ++k) {
    const double before = *members[k], d = 1e-5 * before;
    *members[k] = before + d;
    const Vec3 more = dig.resistance(soil).total().force;
    *members[k] = before - d;
    const Vec3 less = dig.resistance(soil).total().force;
    *members[k] = before;
    const Vec3 by = (more - less) / (2 * d);
    EXPECT_LT((by - r.by_strength.col(k)).norm(), 1e-5 * r.by_strength.col(k).norm()) << k;
  }
}

TEST(Resistance, IsTheWorkOfADragOverItsLength) {
  Dig dig(0.05, make_plane(0.3, {0, 0}), blade());
  dig.to({-1.5, 0, 0}, lean(60));
  double work = 0, last = 0;
  for (int i = 1; i <= 200; ++i) {
    dig.to({-1.5 + 0.01 * i, 0, 0}, lean(60));
    const double force = -turned(dig.resistance().cut, lean(60)).force.x();
    if (i > 20) work += 0.01 * force;  // once it has soil before all of it
    if (last > 0) {
      EXPECT_LT(std::abs(force / last - 1), 0.005) << i;
    }
    last = force;
  }
  EXPECT_NEAR(work, 1.8 * 1.2 * 10296.96, 0.01 * 1.8 * 1.2 * 10296.96);
}

TEST(Resistance, IsNothingInTheAirAndOffTheGround) {
  Dig dig(0.05, field([](double, double) { return 0.3; }), blade());
  dig.to({0, 0, 1}, lean(60));
  EXPECT_EQ(dig.resistance().total().force, Vec3::Zero());
  Dig edge(0.05, field([](double, double) { return 0.3; }), blade());
  edge.to({4.2, 0, 0}, lean(60));
  edge.to({4.4, 0, 0}, lean(60));  // the terrain ends at 5 m
  EXPECT_TRUE(edge.resistance().total().force.allFinite());
  EXPECT_LT(edge.resistance().cut.force.x(), 0);
  Bucket closed = blade();
  EXPECT_THROW(Site(edge.site).cut_geometry(1, edge.heights), std::invalid_argument);
}

TEST(CutGeometry, ResistsAlikeAfterItWasBytes) {
  Bucket sharp = bucket(), blunt = bucket();
  blunt.edge_m = 0.02;
  blunt.plate_m = 0.03;
  for (const Bucket& of : {sharp, blunt}) {
    for (const double pitch : {0.3, -0.1}) {  // with a heel
      Dig dig(0.05, make_plane(0.02, {0.1, 0.05}), of);
      for (int i = 0; i < 20; ++i)
        dig.to({0.05 * i, 0, 0.1 - 0.03 * std::min(i, 12)}, from_rpy(0, 0.3, 0.2));
      dig.to({1.0, 0, -0.3}, from_rpy(0, pitch, 0.2));
      const CutGeometry geometry = dig.site.cut_geometry(0, dig.heights);
      const std::string bytes = geometry.save();
      const CutGeometry again = CutGeometry::load(bytes);
      EXPECT_EQ(again.save(), bytes);
      EXPECT_EQ(again.world_from_bucket().position, geometry.world_from_bucket().position);
      for (const bool crescents : {false, true}) {
        const Resistance one = geometry.resistance(kLoam, crescents);
        const Resistance other = again.resistance(kLoam, crescents);
        EXPECT_EQ(one.total().force, other.total().force);
        EXPECT_EQ(one.total().moment, other.total().moment);
        EXPECT_EQ(one.by_strength, other.by_strength);
        EXPECT_NE(one.total().force.norm(), 0);
      }
      for (const std::size_t size :
           {std::size_t{0}, std::size_t{1}, bytes.size() / 2, bytes.size() - 1})
        EXPECT_THROW(CutGeometry::load(bytes.substr(0, size)), std::invalid_argument) << size;
      EXPECT_THROW(CutGeometry::load(bytes + "0"), std::invalid_argument);
      for (std::size_t at = 0; at < 400; ++at) {  // an absurd number of anything is no other error
        std::string bad = bytes;
        bad.replace(at, 8, std::string("\0\0\0\0\0\0\0\x10", 8));
        try {
          CutGeometry::load(bad);
        } catch (const std::invalid_argument&) {
        }
      }
      EXPECT_THROW(CutGeometry::load("\1" + bytes.substr(1)), std::invalid_argument);
    }
  }
}

/// A bucket that digs, bears on its heel, is lifted off, and rolls over.
TEST(CutGeometry, LooksAgainInTheSameStorage) {
  Bucket blunt = bucket();
  blunt.edge_m = 0.02;
  blunt.plate_m = 0.03;
  Earthmoving soil;
  soil.soil = SoilProperties{};
  soil.soil->repose_rad = 0.6;
  soil.soil->swell = 0.25;
  Dig dig(0.05, field([](double x, double y) { return 0.1 * std::sin(3 * x) + 0.05 * y; }), blunt,
          soil);
  CutGeometry used;
  EXPECT_EQ(used.resistance(kLoam).total().force, Vec3::Zero());
  struct Place {
    Vec3 position, rpy;
  };
  const Place places[] = {{{-1, 0, -0.2}, {0, 0.3, 0}},
                          {{-0.5, 0, -0.3}, {0, 0.3, 0}},
                          {{0, 0.1, -0.3}, {0, -0.4, 0}},
                          {{0, 0.1, 0.1}, {1.4, 0, 0}},
                          {{0, 0.1, 0.9}, {0, 0, 0}}};
  bool pressed = false, rolled = false, cut = false;
  for (int n = 0; n < 2; ++n) {  // the first round finds how much room they need
    for (const Place& place : places) {
      dig.to(place.position, from_rpy(place.rpy.x(), place.rpy.y(), place.rpy.z()));
      const CutGeometry fresh = dig.site.cut_geometry(0, dig.heights);
      const std::size_t before = allocations;
      dig.site.cut_geometry(0, dig.heights, used);
      const Resistance r = used.resistance(kLoam);
      if (n > 0) {
        EXPECT_EQ(allocations, before);
      }
      EXPECT_TRUE(used.save() == fresh.save());
      pressed = pressed || r.pressed;
      rolled = rolled || r.rolled;
      cut = cut || r.cut.force.norm() > 0;
    }
  }
  EXPECT_TRUE(pressed && rolled && cut);
#ifdef SOILVDB_COUNTS_ALLOCATIONS
  EXPECT_GT(allocations, 0u);
#endif
  Bucket closed = blade();
  std::vector<float> distances(27, 0.1f);
  distances[13] = -0.1f;
  closed.shape =
      std::make_shared<ToolShape>(Vec3(-0.1, -0.1, -0.1), 0.1, Coord3(3, 3, 3), distances);
  const std::string before = used.save();
  EXPECT_THROW(used.read(dig.heights, *dig.ground, closed, {}, Vec3::Zero(), 0),
               std::invalid_argument);
  EXPECT_TRUE(used.save() == before);
}

TEST(Session, AsksForAForceWithoutAllocating) {
  Earthmoving soil;
  soil.soil = SoilProperties{};
  soil.soil->repose_rad = 0.6;
  soil.soil->swell = 0.25;
  Session session({.voxel_size_m = 0.05, .machines = {{"digger", bucket()}}, .earthmoving = soil});
  for (const double x : {-1., -0.5, 0.})
    ASSERT_TRUE(
        session.update({.machine = 0, .pose = {Vec3(x, 0, -0.3), from_rpy(0, 0.3, 0)}}).ok());
  const Vec3 first = session.resistance(0).total().force;
  const std::size_t before = allocations;
  EXPECT_EQ(session.resistance(0).total().force, first);
  EXPECT_LT(session.resistance(0, &kLoam).cut.force.x(), 0);
  EXPECT_EQ(allocations, before);
}

TEST(Strength, TakesWhatTheSoilOfASiteSays) {
  SoilProperties soil;
  EXPECT_THROW(SoilStrength::of(soil), std::invalid_argument);
  soil.repose_rad = 0.6;
  EXPECT_EQ(SoilStrength::of(soil).friction_rad, 0.6);
  EXPECT_DOUBLE_EQ(SoilStrength::of(soil).tool_friction_rad, 0.4);
  EXPECT_EQ(SoilStrength::of(soil).cohesion_pa, 0);
  soil.friction_rad = 0.3;
  soil.cohesion_pa = 1000;
  soil.tool_friction_rad = 0.1;
  soil.adhesion_pa = 50;
  const SoilStrength all = SoilStrength::of(soil);
  EXPECT_EQ(all.friction_rad, 0.3);
  EXPECT_EQ(all.cohesion_pa, 1000);
  EXPECT_EQ(all.tool_friction_rad, 0.1);
  EXPECT_EQ(all.adhesion_pa, 50);
  soil.adhesion_pa = -1;
  EXPECT_THROW(SoilStrength::of(soil), std::invalid_argument);
}

}  // namespace resistance_test
}  // namespace soilvdb::test
