// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What no machine does is refused, in batches as alone; a site on a plane is where work begins.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "soilvdb/boundary_volume.h"
#include "tests/session/session_fixture.h"

namespace soilvdb::test {
namespace session_limits_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

MachineState digger_at(const Vec3& position, std::optional<double> time_s = {}) {
  return {.machine = 0, .time_s = time_s, .pose = {position, {1, 0, 0, 0}}};
}

TEST(SessionLimits, BatchesAreRefusedAtTheFirstStateThatNoMachineHasAfterTheOneBefore) {
  Session session(site_of());
  ASSERT_TRUE(session.update(digger_at({0, 0, 1}, 1)).ok());
  const std::string before = session.save();
  // Each is near the one before it, but the last.
  std::vector<MachineState> states;
  for (int i = 1; i <= 4; ++i) states.push_back(digger_at({60.0 * i, 0, 1}, 1 + 2 * i));
  states.push_back(digger_at({240, 101, 1}, 20));
  const BatchResult refused = session.update(states);
  EXPECT_EQ(refused.status, Status::kBadState);
  EXPECT_EQ(refused.bad, 4u);
  EXPECT_THAT(refused.why, HasSubstr("machine 'digger': would move 101 m in one state"));
  EXPECT_EQ(session.save(), before);
  EXPECT_EQ(session.unlikely(states[4]),
            "machine 'digger': would move 260.386 m in one state; are "
            "these metres? Consecutive states are at most 100 m apart");
  states.back().pose.position.y() = 99;
  EXPECT_TRUE(session.update(states).ok());
  EXPECT_NE(session.unlikely(digger_at({240, 99, 20}, 20.1)), "") << "19 m in 0.1 s";
  EXPECT_EQ(session.unlikely(digger_at({240, 99, 20}, 20.5)), "");
  MachineState turned = digger_at({240, 99, 1}, 20.1);
  turned.pose.rotation = Eigen::AngleAxisd(1.3, Vec3::UnitY());
  EXPECT_THAT(session.unlikely(turned), HasSubstr("the bucket turns 1.3 rad in 0.1 s"));
  session.set_limits(false);
  EXPECT_FALSE(session.clone().limits());
  EXPECT_TRUE(session.update(turned).ok());
  EXPECT_THROW(session.unlikely({.machine = 9}), std::invalid_argument);
}

// Whatever happens to the session meanwhile.
TEST(SessionLimits, ABucketThatGoesBackwardsIsWarnedOfOnceInASessionThatChanges) {
  Session session(site_of());
  int warned = 0;
  for (int i = 0; i < 100; ++i) {
    if (i == 30) session.restore(session.save());
    if (i == 50)
      session.change_list("machines",
                          R"({"add": {"name": "hoe", "bucket": {"width": 1, "height": 1}}})");
    ASSERT_TRUE(session.update(digger_at({1 - 0.1 * i, 0, 0}, i)).ok());
    warned += static_cast<int>(session.take_warnings().size());
  }
  EXPECT_EQ(warned, 1);
}

TEST(SessionLimits, ABucketThatGoesBackwardsIsWarnedOfOnceHoweverItIsFed) {
  for (const bool batches : {false, true}) {
    Session session(site_of());
    int warned = 0;
    for (int i = 0; i < 60; ++i) {
      const std::vector<MachineState> states = {digger_at({1 - 0.1 * i, 0, 0}, i)};
      if (batches)
        ASSERT_TRUE(session.update(states).ok());
      else
        ASSERT_TRUE(session.update(states[0]).ok());
      for (const std::string& line : session.take_warnings()) {
        EXPECT_THAT(line, HasSubstr("machine 'digger' moved backwards through soil for 2 m"));
        EXPECT_NEAR(i, 21, 2);
        ++warned;
      }
    }
    EXPECT_EQ(warned, 1);
  }
}

TEST(SessionLimits, VoxelsThatAreTooLargeForABucketAreWarnedOf) {
  SessionSite site = site_of();  // plate: 1 m x 0.6 m
  site.voxel_size_m = 0.3;
  EXPECT_TRUE(Session(site).take_warnings().empty());
  site.voxel_size_m = 0.31;
  Session session(site);
  EXPECT_TRUE(session.clone().take_warnings().empty()) << "once";
  EXPECT_THAT(session.take_warnings(),
              ElementsAre("voxels of 0.31 m are too large for the bucket of plate, 1 m x 0.6 m; "
                          "volumes will be off by percents or more, use 0.12 m or less"));
  EXPECT_TRUE(session.take_warnings().empty());
  session.change_list("machines",
                      R"({"add": {"name": "hoe", "bucket": {"width": 0.1, "height": 0.15}}})");
  EXPECT_THAT(session.take_warnings(),
              ElementsAre("voxels of 0.31 m are larger than the bucket of hoe, 0.1 m x 0.15 m, and "
                          "would show nothing of what it digs; the voxel size must be 0.02 m or "
                          "less"));
}

TEST(SessionPlaces, APlaneIsDugInAnyCoordinates) {
  for (const bool batch : {false, true}) {
    Session session(site_of());
    Session fresh(site_of());
    const Vec3 utm(512340, 5403640, 0);
    std::vector<MachineState> states;
    for (int i = 0; i < 20; ++i) states.push_back(digger_at(utm + Vec3(0.1 * i, 0, -0.1), i));
    for (MachineState& state : states) state.pose.position.z() = 0.05 * utm.x();  // 0.2 m deep
    if (batch) {
      ASSERT_TRUE(session.update(states).ok());
    } else {
      for (const MachineState& state : states) ASSERT_TRUE(session.update(state).ok());
    }
    EXPECT_LT(session.change_m3(), -0.3);
    EXPECT_LT((session.origin() - utm).head<2>().norm(), 10000);
    fresh.restore(session.save());
    EXPECT_EQ(fresh.save(), session.save());
    EXPECT_EQ(fresh.ground_hash(), session.ground_hash());
    SessionSite fixed = site_of();
    fixed.near_m = Vec3::Zero();
    Session there(fixed);
    const StepResult refused = there.update(states.front());
    EXPECT_EQ(refused.status, Status::kBadState);
    EXPECT_THAT(refused.why, HasSubstr("it must be within 838859 m of (0, 0, 0)"));
    EXPECT_THROW(there.restore(session.save()), std::invalid_argument);
    const std::vector<Vec2> box = {utm.head<2>() + Vec2(-3, -3), utm.head<2>() + Vec2(5, -3),
                                   utm.head<2>() + Vec2(5, 3), utm.head<2>() + Vec2(-3, 3)};
    const BoundaryVolume volume = session.volume(box);
    EXPECT_NEAR(volume.net_m3, session.change_m3(), 1e-9);
    EXPECT_NEAR(volume.area_m2, 48, 1e-6);
    EXPECT_FALSE(volume.to_design);
  }
  Session far(site_of());
  EXPECT_FALSE(far.update(digger_at({1e12, 0, 0})).ok()) << "nowhere on the earth";
  EXPECT_TRUE(far.update(digger_at({0, 0, 0})).ok());
}

/// However large the area around it, and whatever it is compared with.
TEST(SessionPlaces, VolumesToADesignFindANarrowCut) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> any(-1, 1);
  for (int scene = 0; scene < 4; ++scene) {
    Session session(site_of());
    double t = 0;
    for (int stroke = 0; stroke < 3; ++stroke) {
      const Vec3 from(4 * any(random), 4 * any(random), -0.3 + 0.1 * any(random));
      for (int i = 0; i < 20; ++i)
        ASSERT_TRUE(
            session.update(digger_at(from + Vec3(0.1 * i, 0, i % 19 == 0 ? 2 : 0), t++)).ok());
    }
    const auto terrain = make_plane(0.2, {0.05, 0}), above = make_plane(0.7, {0.05, 0});
    for (const double side_m : {40.0, 300.0, 3000.0}) {
      const double a = side_m / 2 + any(random);
      const std::vector<Vec2> box = {{-a, -a}, {a, -a}, {a, a}, {-a, a}};
      const BoundaryVolume as_was = session.volume(box, terrain.get());
      ASSERT_GT(as_was.cut_m3, 0.5);
      EXPECT_NEAR(as_was.to_design->fill_m3, as_was.cut_m3, 0.01 * as_was.cut_m3) << side_m;
      EXPECT_NEAR(as_was.to_design->cut_m3, as_was.fill_m3, 0.01 * as_was.cut_m3) << side_m;
      EXPECT_NEAR(as_was.to_design->area_m2, 4 * a * a, 1e-6 * a * a);
      const BoundaryVolume raised = session.volume(box, above.get());
      EXPECT_NEAR(raised.to_design->fill_m3 - 0.5 * 4 * a * a, as_was.cut_m3 - as_was.fill_m3,
                  0.01 * as_was.cut_m3)
          << side_m;
    }
  }
}

TEST(SessionPlaces, APourIsAPlaceAsWell) {
  SessionSite site = site_of(moving());
  for (Pour& pour : site.earthmoving.pours) pour.at_m += Vec3(512340, 5403640, 25617);
  Session session(site);
  ASSERT_TRUE(session.pour(60).ok());
  ASSERT_TRUE(session.come_to_rest().ok());
  EXPECT_GT(session.change_m3(), 2);
}

}  // namespace session_limits_test
}  // namespace soilvdb::test
