// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Motions that no machine makes, and angles that may be in degrees: what is said, and what is
// refused.
#include <gtest/gtest.h>

#include <cstdint>
#include <numbers>
#include <utility>

#include "soilvdb/io/motion_csv.h"
#include "tests/io/motion_csv_fixture.h"

namespace soilvdb::io {
namespace motion_plausibility_test {

TEST_F(MotionCsv, AnglesThatLookLikeDegreesAreWarnedOf) {
  EXPECT_TRUE(read("time,x,y,z,yaw\n0,0,0,0,6.2\n1,0,0,0,-6.2\n").warnings.empty());
  EXPECT_EQ(read("time,x,y,z,yaw\n0,0,0,0,0\n1,0,0,0,45\n2,0,0,0,90\n").warnings,
            std::vector<std::string>{(folder_ / "m.csv").string() +
                                     ": roll, pitch or yaw is beyond a turn in 2 rows, first at "
                                     "line 3; they must be in radians, not degrees, unless "
                                     "'angles: degrees' is beside the machine's 'motion:'"});
}

TEST_F(MotionCsv, JointsBeyondTheirLimitsAreCountedInOneWarningPerJoint) {
  const auto [motion, warnings] = read_joints(
      "time,boom_joint,arm_joint\n0,0,0\n1,0.770000001,0\n2,0.8,0\n3,0,-1.3\n4,0.85,0\n");
  ASSERT_EQ(warnings.size(), 2u);
  const std::string file = (folder_ / "m.csv").string();
  EXPECT_EQ(warnings[0], file +
                             ": joint boom_joint exceeds its limits (-1.22 to 0.77 rad) in 2 "
                             "rows, first at line 4");
  EXPECT_EQ(warnings[1],
            file +
                ": joint arm_joint exceeds its limits (-1.22 to 0.77 rad) in 1 row, first at "
                "line 5");
}

TEST_F(MotionCsv, BucketsAndJointsThatJump) {
  EXPECT_EQ(error("time,x,y,z\n0,0,0,0\n0.1,0,7,0\n"),
            "m.csv:3: the bucket moves 7 m in 0.1 s since the row before; no machine does more "
            "than 50 m/s");
  EXPECT_EQ(error("time,x,y,z,yaw\n0,0,0,0,0\n0.1,0,0,0,3.1\n"),
            "m.csv:3: the bucket turns 3.1 rad in 0.1 s since the row before; no machine does more "
            "than 10 rad/s");
  EXPECT_EQ(joints_error("time,boom_joint,arm_joint\n0,0,0.7\n0.1,0,-1.2\n"),
            "m.csv:3: joint arm_joint turns 1.9 rad in 0.1 s since the row before; no machine does "
            "more than 10 rad/s");
  Chain swing;
  swing.joints = {{"swing", Joint::Type::kContinuous, {}, Vec3::UnitZ(), 0, 0}};
  const auto turned = folder_.write("m.csv", "time,swing\n0,0\n1e6,120\n");
  EXPECT_EQ(test::message_of(folder_, [&] { read_motion(turned, swing); }),
            "m.csv:3: joint swing turns 120 rad since the row before; at most 100 rad in one row");
  Chain slide;
  slide.joints = {{"slide", Joint::Type::kPrismatic, {}, Vec3::UnitX(), 0, 0}};
  const auto file = folder_.write("m.csv", "time,slide\n0,0\n1e6,-1001\n");
  EXPECT_EQ(test::message_of(folder_, [&] { read_motion(file, slide); }),
            "m.csv:3: joint slide moves -1001 m since the row before; at most 1000 m in one row");
  EXPECT_EQ(error("time,x,y,z\n0,0,0,0\n0.001,0.9,0,0\n").substr(0, 40),
            "m.csv:3: the bucket moves 0.9 m in 0.001");
  EXPECT_EQ(error("time,x,y,z,yaw\n0,0,0,0,0\n0.001,0,0,0,0.9\n").substr(0, 42),
            "m.csv:3: the bucket turns 0.9 rad in 0.001");
  // Noise at a high rate is no jump, and neither is a machine that was driven on meanwhile.
  read("time,x,y,z,yaw\n0,0,0,0,0\n0.001,0.2,0,0,0.2\n1000,9000,0,0,0\n");
}

TEST_F(MotionCsv, AJointThatWrapsGoesOnPastAWholeTurnWhateverTheRate) {
  Chain swing;
  swing.joints = {{"swing", Joint::Type::kContinuous, {}, Vec3::UnitZ(), 0, 0}};
  const auto read_on = [&](const std::string& content) {
    MotionReader reader(folder_.write("m.csv", "time,swing\n" + content), swing);
    reader.next(100);
    EXPECT_EQ(reader.bad_rows().count, 0);
    return reader.warnings();
  };
  const auto second = [&](const std::string& content) {
    return read_motion(folder_.write("m.csv", "time,swing\n" + content), swing)
        .motion.joint_values()[1];
  };
  for (const std::string after : {"0.02", "0.5", "1", "3"})
    EXPECT_NEAR(second("0,3.1\n" + after + ",-3.1\n"), 2 * std::numbers::pi - 3.1, 1e-12);
  EXPECT_NEAR(second("0,0.05\n1,6.2\n"), 6.2 - 2 * std::numbers::pi, 1e-12);
  EXPECT_TRUE(read_on("0,3.1\n0.02,3.183\n1,3.5\n").empty());
  // Slow enough to be what a machine did.
  EXPECT_EQ(read_on("0,3.1\n10,-3.1\n20,3\n"),
            std::vector<std::string>{
                (folder_ / "m.csv").string() +
                ": joint swing turns more than half a turn at once in 2 rows, first at line 3; if "
                "it wraps there, it must go on past a whole turn"});
  // Limits of half a turn either way are where a sensor wraps, not where the joint stops.
  swing.joints[0] = {"swing",       Joint::Type::kRevolute, {},
                     Vec3::UnitZ(), -std::numbers::pi,      std::numbers::pi};
  EXPECT_NEAR(second("0,3.1\n0.5,-3.1\n"), 2 * std::numbers::pi - 3.1, 1e-12);
  EXPECT_TRUE(read_on("0,3.1\n0.5,-3.1\n1,-2.9\n").empty()) << "no warning of limits";
  EXPECT_EQ(read_on("0,3.1\n1,3.5\n2,4.5\n").size(), 1u) << "beyond its limits in 2 rows";
  // A spike is no wrap, nor is what limits keep from turning.
  EXPECT_EQ(test::message_of(
                folder_,
                [&] { read_motion(folder_.write("m.csv", "time,swing\n0,0\n0.5,20\n"), swing); }),
            "m.csv:3: joint swing turns 20 rad in 0.5 s since the row before; no machine does more "
            "than 10 rad/s");
  EXPECT_EQ(joints_error("time,boom_joint,arm_joint\n0,0,0\n0.1,0,6.28\n").substr(0, 40),
            "m.csv:3: joint arm_joint is at 6.28 rad;");
}

TEST_F(MotionCsv, JointsClearlyBeyondTheirLimitsAreBadRows) {
  EXPECT_EQ(joints_error("time,boom_joint,arm_joint\n0,0,0\n10,0,0.88\n"),
            "m.csv:3: joint arm_joint is at 0.88 rad; the urdf limits it to -1.22 to 0.77, and at "
            "most 0.1 beyond is accepted");
  EXPECT_EQ(joints_error("time,boom_joint,arm_joint\n0,-1.33,0\n").substr(0, 42),
            "m.csv:2: joint boom_joint is at -1.33 rad;");
  Chain slide;
  slide.joints = {{"slide", Joint::Type::kPrismatic, {}, Vec3::UnitX(), 0, 2}};
  const auto of = [&](const std::string& rows) {
    const auto file = folder_.write("m.csv", "time,slide\n" + rows);
    return test::message_of(folder_, [&] { read_motion(file, slide); });
  };
  EXPECT_EQ(of("0,2.05\n"), "nothing thrown");
  EXPECT_EQ(of("0,2.2\n"),
            "m.csv:2: joint slide is at 2.2 m; the urdf limits it to 0 to 2, and at most 0.1 "
            "beyond is accepted");
}

TEST_F(MotionCsv, JointsClearlyFasterThanTheirUrdfHasThemAreBadRows) {
  Chain chain;
  chain.joints = {{"boom", Joint::Type::kRevolute, {}, Vec3::UnitY(), -1, 1, 0.5}};
  const auto of = [&](const std::string& rows) {
    const auto file = folder_.write("m.csv", "time,boom\n" + rows);
    return test::message_of(folder_, [&] { read_motion(file, chain); });
  };
  EXPECT_EQ(of("0,0\n0.1,0.06\n0.101,0.1\n1,0.9\n"), "nothing thrown") << "loads, noise";
  EXPECT_EQ(of("0,0\n0.1,0.2\n"),
            "m.csv:3: joint boom turns 0.2 rad in 0.1 s since the row before; its velocity limit "
            "in the urdf is 0.5 rad/s, and at most twice that is accepted");
  chain.joints[0].fastest = 0;
  EXPECT_EQ(of("0,0\n0.1,0.2\n"), "nothing thrown") << "it has none";
}

TEST_F(MotionCsv, JointsInDegreesAreToldFromRadians) {
  Chain chain;
  chain.joints = {{"swing", Joint::Type::kContinuous, {}, Vec3::UnitZ(), 0, 0},
                  {"boom", Joint::Type::kRevolute, {}, Vec3::UnitY(), -1, 1}};
  const auto of = [&](const std::string& rows, AngleUnit unit) {
    const auto file = folder_.write("m.csv", "time,swing,boom\n" + rows);
    return test::message_of(folder_, [&] { read_motion(file, chain, unit); });
  };
  // Its second row would be a wrap, its third nothing but an angle.
  const std::string degrees = "0,0,20\n0.1,6.2,21\n0.2,12,0\n";
  EXPECT_EQ(of(degrees, AngleUnit::kRadians),
            "m.csv:2: boom is 20 rad, more than a whole turn, and 2 of 3 rows have such angles: "
            "they look like degrees; make them radians, or say 'angles: degrees' beside the "
            "machine's 'motion:'");
  EXPECT_EQ(of(degrees, AngleUnit::kDegrees), "nothing thrown");
  EXPECT_EQ(
      of("0,0,0\n0.1,0,0.1\n0.2,0,30\n", AngleUnit::kRadians),
      "m.csv:4: joint boom is at 30 rad; the urdf limits it to -1 to 1, and at most 0.1 beyond is "
      "accepted; if these are degrees, say 'angles: degrees' beside the machine's 'motion:'")
      << "the odd row";
  EXPECT_EQ(of("0,0,70\n", AngleUnit::kDegrees),
            "m.csv:2: joint boom is at 70 degrees; the urdf limits it to -57.296 to 57.296, and at "
            "most 5.7296 beyond is accepted");
  EXPECT_NEAR(read_motion(folder_.write("m.csv", "time,swing,boom\n0,179,0\n1,-179,0\n"), chain,
                          AngleUnit::kDegrees)
                  .motion.joint_values()[2],
              181 * std::numbers::pi / 180, 1e-12);
  const auto file = folder_.write("m.csv", "time,swing,boom\n0,360,45\n");
  const Motion motion = read_motion(file, chain, AngleUnit::kDegrees).motion;
  EXPECT_NEAR(motion.joint_values()[0], 2 * std::numbers::pi, 1e-12);
  EXPECT_NEAR(motion.joint_values()[1], std::numbers::pi / 4, 1e-12);
}

TEST_F(MotionCsv, AnglesOfPosesMayBeInDegreesWhereTheySaySo) {
  const std::string pitched = "time,x,y,z,pitch,yaw\n0,0,0,0,30,90\n1,0,0,0,31,90\n";
  EXPECT_EQ(error(pitched).substr(0, 50), "m.csv:2: pitch is 30 rad, more than a whole turn, ");
  const auto [motion, warnings] =
      read_motion(folder_.write("m.csv", pitched), std::nullopt, AngleUnit::kDegrees);
  EXPECT_TRUE(motion.row(0).rotation.isApprox(
      from_rpy(0, std::numbers::pi / 6, std::numbers::pi / 2), 1e-12));
  EXPECT_TRUE(warnings.empty());
}

TEST_F(MotionCsv, RowsThatOutnumberAllBeforeThemAreCounted) {
  const auto outnumbered = [&](const std::string& rows) {
    MotionReader reader(folder_.write("m.csv", "time,x,y,z\n" + rows), std::nullopt);
    reader.next(100);
    return std::pair(reader.bad_rows().outnumbering, reader.bad_rows().outnumbered);
  };
  using P = std::pair<std::int64_t, long>;
  EXPECT_EQ(outnumbered("0,0,0,0\n0.1,900,0,0\n0.2,900,0,0\n30,900,0,0\n31,900,0,0\n"), P(2, 2));
  EXPECT_EQ(outnumbered("0,0,0,0\n0.1,900,0,0\n0.2,0,0,0\n0.3,0,0,0\n0.4,9,0,0\n0.5,9,0,0\n"),
            P(0, 0))
      << "those after it side with the first";
}

}  // namespace motion_plausibility_test
}  // namespace soilvdb::io
