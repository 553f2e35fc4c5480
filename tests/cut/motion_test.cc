// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "soilvdb/tracker.h"

namespace soilvdb {
namespace motion_test {

constexpr double kPi = std::numbers::pi;

Bucket bucket() {
  Bucket b;
  b.width_m = 0.5;
  b.height_m = 0.8;
  return b;
}

Motion half_sine(int rows) {
  std::vector<double> times;
  std::vector<Pose> poses;
  for (int i = 0; i < rows; ++i) {
    const double t = static_cast<double>(i) / (rows - 1);
    times.push_back(t);
    poses.push_back({{-0.5 * std::cos(kPi * t), 0, -0.25 * std::sin(kPi * t)}});
  }
  return {times, poses};
}

TEST(Motion, SimplifiedStaysWithinItsToleranceWithFewerRows) {
  const Motion motion = half_sine(4001);
  constexpr double kTolerance = 1e-5;
  const Motion simple = motion.simplified(bucket(), kTolerance);
  EXPECT_LT(simple.times_s().size(), motion.times_s().size() / 8);
  EXPECT_EQ(simple.begin_s(), motion.begin_s());
  EXPECT_EQ(simple.end_s(), motion.end_s());
  for (const double t : motion.times_s()) {
    EXPECT_LE((simple.pose(t).position - motion.pose(t).position).norm(), kTolerance);
  }
}

TEST(Motion, StandingStillSimplifiesToItsEnds) {
  EXPECT_EQ(Motion({0, 1, 2, 3, 4}, std::vector<Pose>(5)).simplified(bucket(), 1e-6).times_s(),
            (std::vector<double>{0, 4}));
}

TEST(Motion, RefusesRowsThatAreNone) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  Chain chain;
  chain.joints = {{"swing", Joint::Type::kContinuous, {}, Vec3::UnitZ(), 0, 0},
                  {"stick", Joint::Type::kPrismatic, {}, Vec3::UnitX(), 0, 0}};
  for (const double v : {kNan, kInf, -kInf, 1e308, 1e10, 1001.0}) {
    EXPECT_THROW(Motion({0, 1}, std::vector<double>{0, 0, v, 0}, chain), std::invalid_argument);
    EXPECT_THROW(Motion({0, 1}, std::vector<double>{0, 0, 0, v}, chain), std::invalid_argument);
    if (v == 1001) continue;  // far for a joint, not for a bucket
    std::vector<Pose> poses(2);
    poses[1].position.y() = v;
    EXPECT_THROW(Motion({0, 1}, poses), std::invalid_argument);
    poses[1] = poses[0];
    poses[1].rotation.z() = v;
    EXPECT_THROW(Motion({0, 1}, poses), std::invalid_argument);
    if (v < kInf && v > 0) continue;  // late, but a time
    EXPECT_THROW(Motion({0, v}, std::vector<Pose>(2)), std::invalid_argument);
  }
  EXPECT_NO_THROW(Motion({0, 1}, std::vector<double>{5e5, 5e6, 5e5, 5e6}, chain));
}

/// A mouth of width 0.5 at radius 3 about a vertical axis, all of it below the ground, digs a ring
/// of volume height * pi (3.25^2 - 2.75^2), however many turns and rows it makes.
TEST(Motion, WholeTurnsOfAJointAreSwept) {
  Chain chain;
  chain.joints = {{"q", Joint::Type::kContinuous, {}, Vec3::UnitZ(), 0, 0}};
  chain.link_from_bucket = {{0, -3, -1}, Eigen::Quaterniond::Identity()};
  const double ring_m3 = 0.8 * kPi * (3.25 * 3.25 - 2.75 * 2.75);
  for (const double turns : {1.0, 2.0, 4.0, 10.0}) {
    const Motion motion({0, 1}, std::vector<double>{0, 2 * kPi * turns}, chain);
    Ground ground(0.05, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(ground, {bucket()});
    tracker.update(0, motion, 0, 1);
    EXPECT_NEAR(tracker.total().cut_m3(), ring_m3, 2e-3 * ring_m3) << turns << " turns";
  }
}

}  // namespace motion_test
}  // namespace soilvdb
