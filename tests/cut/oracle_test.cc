// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The oracle against closed forms, against itself along other lines, and against random points.
#include "tests/support/oracle.h"

#include <gtest/gtest.h>

#include "tests/support/families.h"
#include "tests/support/scenarios.h"

namespace soilvdb::test {
namespace oracle_test {

/// A sixth of the tightest tolerance that an engine is held to (0.03 %).
constexpr double kGoodTruth = 5e-5;

Terrain plane(const Family& f) {
  return {[f](const Vec2& p) { return f.height_m + f.slope.dot(p); }, true};
}

const Family& family(const std::string& name) {
  for (const Family& f : all_families()) {
    if (f.name == name) return f;
  }
  throw std::logic_error("no family " + name);
}

TEST(Oracle, AgreesWithEveryClosedForm) {
  for (const Family& f : all_families()) {
    if (!f.closed_form_m3) continue;
    const Volume v = f.planar ? planar_volume(f.sweep(), plane(f), f.direction, 6000, 1)
                              : spatial_volume(f.sweep(), plane(f), f.direction);
    EXPECT_NEAR(v.m3, *f.closed_form_m3, v.uncertainty_m3) << f.name;
    EXPECT_LT(v.uncertainty_m3, kGoodTruth * v.m3) << f.name;
  }
}

TEST(Oracle, DoesNotDependOnTheDirectionOfItsLines) {
  for (const Family& f : all_families()) {
    if (!f.planar || f.posts || f.slope.y() != 0) continue;
    const Vec3 other = from_rpy(0, -0.2, 0) * f.direction;
    const Volume a = planar_volume(f.sweep(), plane(f), f.direction, 6000, 1);
    const Volume b = planar_volume(f.sweep(), plane(f), other, 6000, 1);
    EXPECT_NEAR(a.m3, b.m3, a.uncertainty_m3 + b.uncertainty_m3) << f.name;
  }
}

TEST(Oracle, SpatialLinesAgreeWithPlanarOnes) {
  for (const char* name : {"drag_curl_retreat", "slope_drag"}) {
    const Family& f = family(name);
    const Vec3 leaning = f.direction + 0.5 * Vec3::UnitY();
    const Volume a = planar_volume(f.sweep(), plane(f), f.direction, 600, 48);
    const Volume b = spatial_volume(f.sweep(), plane(f), leaning);
    EXPECT_NEAR(a.m3, b.m3, a.uncertainty_m3 + b.uncertainty_m3) << name;
  }
}

TEST(Oracle, RandomPointsAgreeWithLines) {
  for (const Family& f :
       {family("drag_curl_retreat"), family("undercut"), family("helix"), random_family(3)}) {
    const Volume lines = f.planar ? planar_volume(f.sweep(), plane(f), f.direction, 6000, 1)
                                  : spatial_volume(f.sweep(), plane(f), f.direction);
    const Volume points = sampled_volume(f.sweep(), plane(f), 20, 1);
    EXPECT_NEAR(lines.m3, points.m3, lines.uncertainty_m3 + points.uncertainty_m3) << f.name;
  }
}

TEST(Oracle, CountsWhatIsPassedTwiceOnce) {
  const Family& f = family("repeated");
  Family once = f;
  once.pose = [pose = f.pose](double t) { return pose(t / 3); };
  once.kinks.clear();
  for (const double t : f.kinks) {
    if (t < 1.0 / 3) once.kinks.push_back(3 * t);
  }
  const Volume thrice = planar_volume(f.sweep(), plane(f), f.direction, 6000, 1);
  const Volume single = planar_volume(once.sweep(), plane(f), f.direction, 6000, 1);
  EXPECT_NEAR(thrice.m3, single.m3, thrice.uncertainty_m3 + single.uncertainty_m3);
}

TEST(Scenarios, EveryTruthIsSharpEnoughToJudgeBy) {
  for (const std::string& name : families()) {
    const Dig dig = make_dig(name, placements().back());
    EXPECT_GT(dig.exact_m3, 0) << name;
    EXPECT_LT(dig.uncertainty_m3, kGoodTruth * dig.exact_m3) << name;
  }
}

TEST(Scenarios, AMotionStaysOnItsContinuousPath) {
  for (const Family& f : all_families()) {
    const Motion motion = f.motion({});
    for (int i = 0; i <= 997; ++i) {
      const double t = i / 997.0;
      const Pose a = motion.pose(t), b = f.pose(t);
      for (const double z : {0.0, f.bucket.height_m}) {
        EXPECT_LT(
            (a * Vec3(0, f.bucket.width_m / 2, z) - b * Vec3(0, f.bucket.width_m / 2, z)).norm(),
            2e-6)
            << f.name << " at " << t;
      }
    }
  }
}

}  // namespace oracle_test
}  // namespace soilvdb::test
