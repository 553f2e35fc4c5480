// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What is read from a motion, and the one line said about each way to get it wrong.
#include "soilvdb/io/motion_csv.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <numbers>

#include "temp_folder.h"

namespace soilvdb::io {
namespace {

using test::TempFolder;

class MotionCsv : public testing::Test {
 protected:
  MotionInput read(const std::string& content) {
    return read_motion(folder_.write("m.csv", content), std::nullopt);
  }
  MotionInput read_joints(const std::string& content) {
    Chain chain;
    for (const char* name : {"boom_joint", "arm_joint"}) {
      Joint joint;
      joint.name = name;
      joint.type = Joint::Type::kRevolute;
      joint.lower = -1.22;
      joint.upper = 0.77;
      chain.joints.push_back(joint);
    }
    return read_motion(folder_.write("m.csv", content), chain);
  }
  std::string error(const std::string& content) {
    return test::message_of(folder_, [&] { read(content); });
  }
  std::string joints_error(const std::string& content) {
    return test::message_of(folder_, [&] { read_joints(content); });
  }

  TempFolder folder_;
};

TEST_F(MotionCsv, PositionsAloneLeaveTheBucketUpright) {
  const auto [motion, warnings] = read("time,x,y,z\n0,1,2,3\n2,5,2,3\n");
  EXPECT_EQ(motion.times_s(), (std::vector<double>{0, 2}));
  EXPECT_EQ(motion.pose(0).position, Vec3(1, 2, 3));
  EXPECT_EQ(motion.pose(1).position, Vec3(3, 2, 3));
  EXPECT_TRUE(motion.pose(0).rotation.isApprox(Eigen::Quaterniond::Identity()));
  EXPECT_TRUE(warnings.empty());
}

TEST_F(MotionCsv, ColumnsMayComeInAnyOrderAndMissingAnglesAreZero) {
  const auto motion = read("yaw,z,y,x,time\n0.5,3,2,1,10\n").motion;
  EXPECT_EQ(motion.begin_s(), 10);
  EXPECT_EQ(motion.end_s(), 10) << "one row is a bucket that stands";
  EXPECT_EQ(motion.pose(10).position, Vec3(1, 2, 3));
  EXPECT_TRUE(motion.pose(10).rotation.isApprox(from_rpy(0, 0, 0.5)));
}

TEST_F(MotionCsv, AQuaternionIsTheSameRotationAsItsAngles) {
  // 90 degrees about z, rounded to five decimals.
  const auto motion = read("time,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0.70711,0.70711\n").motion;
  EXPECT_NEAR(motion.pose(0).rotation.angularDistance(from_rpy(0, 0, std::numbers::pi / 2)), 0,
              1e-7);
  EXPECT_NEAR(motion.pose(0).rotation.norm(), 1, 1e-15);
}

TEST_F(MotionCsv, WindowsLineEndsByteOrderMarkSpacesQuotesAndBlankLastLinesAreFine) {
  const auto [motion, warnings] =
      read("\xEF\xBB\xBF\"time\" , x,\"y\" ,z\r\n 0 , +1,\"2\", -3e0\t\r\n1,1,2,3\r\n\r\n\n");
  EXPECT_EQ(motion.times_s().size(), 2u);
  EXPECT_EQ(motion.pose(0).position, Vec3(1, 2, -3));
  EXPECT_TRUE(warnings.empty());
}

TEST_F(MotionCsv, ALastLineWithoutAnEndCounts) {
  EXPECT_EQ(read("time,x,y,z\n0,0,0,0\n1,0,0,0").motion.end_s(), 1);
}

TEST_F(MotionCsv, SecondsSince1970AndUtmCoordinatesKeepTheirDigits) {
  const auto motion = read("time,x,y,z\n1732180000.125,512345.6789,5403210.1234,431.5\n").motion;
  EXPECT_EQ(motion.begin_s(), 1732180000.125);
  EXPECT_EQ(motion.pose(0).position, Vec3(512345.6789, 5403210.1234, 431.5));
}

TEST_F(MotionCsv, ColumnsItHasNoUseForAreSkippedUnreadWithOneWarning) {
  const auto [motion, warnings] =
      read("time,x,y,z,phase,load\n0,0,0,0,\"dig, deep\",nan\n1,0,0,0,lift,\n");
  EXPECT_EQ(motion.times_s().size(), 2u);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0], (folder_ / "m.csv").string() +
                             ": ignored columns 'phase' and 'load'; 'roll', 'pitch' and "
                             "'yaw' aren't there, taken as 0");
}

TEST_F(MotionCsv, AnglesThatLookLikeDegreesAreWarnedOf) {
  EXPECT_TRUE(read("time,x,y,z,yaw\n0,0,0,0,6.2\n1,0,0,0,-6.2\n").warnings.empty());
  EXPECT_EQ(read("time,x,y,z,yaw\n0,0,0,0,0\n1,0,0,0,45\n2,0,0,0,90\n").warnings,
            std::vector<std::string>{(folder_ / "m.csv").string() +
                                     ": roll, pitch or yaw is beyond a turn in 2 rows, first at "
                                     "line 3; they must be in radians, not degrees, unless "
                                     "'angles: degrees' is beside the machine's 'motion:'"});
}

TEST_F(MotionCsv, AMisspeltAngleIsMissed) {
  const auto [motion, warnings] = read("time,x,y,z,roll,pich,yaw\n0,0,0,0,1,1,1\n");
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0], (folder_ / "m.csv").string() +
                             ": ignored column 'pich'; 'pitch' isn't there, taken as 0");
}

TEST_F(MotionCsv, JointsAreTakenByName) {
  const auto [motion, warnings] =
      read_joints("time,arm_joint,boom_joint,thumb_joint\n0,0.25,0.5,7\n");
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_NE(warnings[0].find("ignored column 'thumb_joint'"), std::string::npos);
  // Both axes are x: the angles add up.
  EXPECT_NEAR(motion.pose(0).rotation.angularDistance(from_rpy(0.75, 0, 0)), 0, 1e-12);
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

TEST_F(MotionCsv, MissingFileFolderOrEmptyFile) {
  const auto of = [&](const std::string& name) {
    return test::message_of(folder_, [&] { read_motion(folder_ / name, std::nullopt); });
  };
  EXPECT_EQ(of("none.csv"), "none.csv: no such file");
  std::filesystem::create_directory(folder_ / "folder");
  EXPECT_EQ(of("folder"), "folder: is a folder; name a file");
  EXPECT_EQ(error(""), "m.csv: is empty; it must be a motion as CSV");
  EXPECT_EQ(error("time,x,y,z\n\n"), "m.csv:2: has a header but no rows; it needs at least one");
}

TEST_F(MotionCsv, BinaryFiles) {
  EXPECT_EQ(error(std::string("II*\0\x10\0\n", 7)),
            "m.csv:1: is a binary file; it must be UTF-8 text");
  EXPECT_EQ(error(std::string(100000, 'a')), "m.csv:1: line is longer than 65536 characters");
}

TEST_F(MotionCsv, MissingColumns) {
  EXPECT_EQ(
      error("x,y,z\n0,0,0\n"),
      "m.csv:1: column 'time' is missing; the header must be time and the columns of a motion");
  EXPECT_EQ(
      error("time,x,z\n0,0,0\n"),
      "m.csv:1: column 'y' is missing; a motion by poses needs time,x,y,z (a motion by joints "
      "needs the machine's urdf)");
  EXPECT_EQ(error("time,boom_joint\n0,0\n"),
            "m.csv:1: columns 'x', 'y' and 'z' are missing; a motion by poses needs time,x,y,z (a "
            "motion by joints needs the machine's urdf)");
  EXPECT_EQ(error("time,x,y,z,qx,qw\n0,0,0,0,0,1\n"),
            "m.csv:1: columns 'qy' and 'qz' are missing; a quaternion needs qx,qy,qz,qw");
  EXPECT_EQ(joints_error("time,x,y,z,boom_joint\n0,0,0,0,0\n"),
            "m.csv:1: column 'arm_joint' is missing; the machine has a urdf, so its motion needs a "
            "column for each joint from the root to the lip: 'boom_joint' and 'arm_joint'");
}

TEST_F(MotionCsv, OtherSeparators) {
  EXPECT_NE(error("time;x;y;z\n0;0;0;0\n").find("; columns must be separated by commas"),
            std::string::npos);
}

TEST_F(MotionCsv, ContradictingColumns) {
  EXPECT_EQ(error("time,x,y,z,x\n0,0,0,0,0\n"),
            "m.csv:1: column 'x' is there twice; leave one out");
  EXPECT_EQ(
      error("time,x,y,z,yaw,qx,qy,qz,qw\n0,0,0,0,0,0,0,0,1\n"),
      "m.csv:1: has both angles (roll, pitch, yaw) and a quaternion (qx, qy, qz, qw); keep one");
  EXPECT_EQ(joints_error("time,boom_joint,arm_joint,x,y,z\n0,0,0,0,0,0\n"),
            "m.csv:1: has both joints and a pose (x, y, z); remove the columns of the pose, or the "
            "machine's urdf");
}

TEST_F(MotionCsv, WhatIsNotANumber) {
  const auto with = [&](const std::string& x) {
    return error("time,x,y,z\n0,0,0,0\n1," + x + ",0,0\n");
  };
  EXPECT_EQ(with("1.5m"), "m.csv:3: x is '1.5m'; it must be a number");
  EXPECT_EQ(with(""), "m.csv:3: x is ''; it must be a number");
  EXPECT_EQ(with("0x10"), "m.csv:3: x is '0x10'; it must be a number");
  EXPECT_EQ(with("+-1"), "m.csv:3: x is '+-1'; it must be a number");
  EXPECT_EQ(with("nan"), "m.csv:3: x is nan; it must be a number within 1e+09");
  EXPECT_EQ(with("-inf"), "m.csv:3: x is -inf; it must be a number within 1e+09");
  EXPECT_EQ(with("1e300"), "m.csv:3: x is 1e300; it must be a number within 1e+09");
  EXPECT_EQ(error("time,x,y,z\n1732180000125,0,0,0\n"),
            "m.csv:2: time is 1732180000125; it must be a number within 1e+11 (seconds)");
}

TEST_F(MotionCsv, NumbersTooSmallToBeMeasured) {
  EXPECT_EQ(error("time,x,y,z\n0,0,0,0\n1,4.9e-324,0,0\n"),
            "m.csv:3: x is 4.9e-324, less than any sensor tells from 0; it must be 0 or a number "
            "beyond 1e-300");
  EXPECT_EQ(error("time,x,y,z\n0,0,0,0\n1e-310,0,0,0\n").substr(0, 23), "m.csv:3: time is 1e-310");
  EXPECT_EQ(error("time,x,y,z\n0,0,0,0\n1,1e-400,0,0\n"),
            "m.csv:3: x is '1e-400'; it must be a number");
}

TEST_F(MotionCsv, AHeaderThatIsMissing) {
  EXPECT_EQ(error("0,0,0,0\n1,1,0,0\n"),
            "m.csv:1: begins with numbers; the first line must name the columns: time,x,y,z and so "
            "on");
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

TEST_F(MotionCsv, AJointThatWrapsIsRefusedWhateverTheRateAndWhateverIsDoneWithBadRows) {
  Chain swing;
  swing.joints = {{"swing", Joint::Type::kContinuous, {}, Vec3::UnitZ(), 0, 0}};
  const auto read_on = [&](const std::string& content) {
    MotionReader reader(folder_.write("m.csv", "time,swing\n" + content), swing);
    reader.next(100);
    EXPECT_EQ(reader.bad_rows().count, 0);
    return reader.warnings();
  };
  for (const std::string after : {"0.02", "0.5", "1", "3"}) {
    EXPECT_EQ(
        test::message_of(folder_, [&] { read_on("0,3.1\n" + after + ",-3.1\n"); }),
        "m.csv:3: joint swing wraps from 3.1 to -3.1 rad; it must go on past a whole turn, to "
        "3.183");
  }
  EXPECT_NE(test::message_of(folder_, [&] { read_on("0,0.05\n1,6.2\n"); }).find("0.05 to 6.2"),
            std::string::npos);
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
  EXPECT_EQ(test::message_of(folder_, [&] { read_on("0,3.1\n0.5,-3.1\n"); }),
            "m.csv:3: joint swing wraps from 3.1 to -3.1 rad; it must go on past a whole turn, to "
            "3.183");
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
            "m.csv:3: joint arm_joint is at 0.88 rad; the urdf limits it to -1.22 to 0.77, and no "
            "more than 0.1 beyond is taken");
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
            "m.csv:2: joint slide is at 2.2 m; the urdf limits it to 0 to 2, and no more than 0.1 "
            "beyond is taken");
}

TEST_F(MotionCsv, JointsClearlyFasterThanTheirUrdfHasThemAreBadRows) {
  Chain chain;
  chain.joints = {{"boom", Joint::Type::kRevolute, {}, Vec3::UnitY(), -1, 1, 0.5}};
  const auto of = [&](const std::string& rows) {
    const auto file = folder_.write("m.csv", "time,boom\n" + rows);
    return test::message_of(folder_, [&] { read_motion(file, chain); });
  };
  EXPECT_EQ(of("0,0\n0.1,0.06\n0.101,0.1\n1,0.9\n"), "nothing thrown") << "loads, noise";
  EXPECT_EQ(
      of("0,0\n0.1,0.2\n"),
      "m.csv:3: joint boom turns 0.2 rad in 0.1 s since the row before; its velocity limit in "
      "the urdf is 0.5 rad/s, and none goes beyond twice that");
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
  EXPECT_EQ(of("0,0,0\n0.1,0,0.1\n0.2,0,30\n", AngleUnit::kRadians),
            "m.csv:4: joint boom is at 30 rad; the urdf limits it to -1 to 1, and no more than 0.1 "
            "beyond is taken; if these are degrees, say 'angles: degrees' beside the machine's "
            "'motion:'")
      << "the odd row";
  EXPECT_EQ(of("0,0,70\n", AngleUnit::kDegrees),
            "m.csv:2: joint boom is at 70 degrees; the urdf limits it to -57.296 to 57.296, and no "
            "more than 5.7296 beyond is taken");
  EXPECT_EQ(of("0,179,0\n1,-179,0\n", AngleUnit::kDegrees),
            "m.csv:3: joint swing wraps from 179 to -179 degrees; it must go on past a whole turn, "
            "to 181");
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

TEST_F(MotionCsv, AColumnInOtherCaseIsTold) {
  for (const std::string name : {"Pitch", "PITCH"}) {
    const auto warnings = read("time,x,y,z," + name + "\n0,0,0,0,1\n").warnings;
    ASSERT_EQ(warnings.size(), 1u);
    EXPECT_TRUE(
        warnings[0].ends_with("aren't there, taken as 0; did you mean 'pitch' by '" + name + "'?"))
        << warnings[0];
  }
  const std::string message = error("Time,X,y,z\n0,0,0,0\n");
  EXPECT_TRUE(message.ends_with("; did you mean 'time' by 'Time'?")) << message;
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

TEST_F(MotionCsv, ReadingGoesOnAfterEachBadRowAsIfItWereNotThere) {
  const std::string anywhere =  // twelve lines
      "nan,1,1,1\n1,inf,1,1\n1,1e308,0,0\n1,5e-324,0,0\n1,2\n1,2,3,4,5\n1,,0,0\n1,zero,0,0\n\n\n" +
      std::string("1,\0,0,0\n", 8) + std::string(300'000, '7') + "\n";
  const std::string after_a_row = "0,0,0,0\n-1,0,0,0\n1,500,0,0\n";
  const auto file =
      folder_.write("m.csv", "time,x,y,z\n" + anywhere + "0.5,1,2,3\n" + anywhere + after_a_row +
                                 "1.5,2,2,3\n" + anywhere + after_a_row + "2,3,2,3\n\n");
  MotionReader reader(file, std::nullopt);
  const Motion motion = reader.next(10);
  EXPECT_EQ(motion.times_s(), (std::vector<double>{0.5, 1.5, 2}));
  EXPECT_EQ(motion.row(1).position, Vec3(2, 2, 3));
  EXPECT_EQ(reader.bad_rows().count, 42);
  EXPECT_EQ(reader.bad_rows().first, file.string() +
                                         ":2: time is nan; it must be a number within "
                                         "1e+11 (seconds)");
  EXPECT_FALSE(reader.bad_rows().good_s);
}

TEST_F(MotionCsv, AQuaternionFarFromUnit) {
  const auto with = [&](const std::string& q) {
    return error("time,x,y,z,qx,qy,qz,qw\n0,0,0,0," + q + "\n");
  };
  EXPECT_EQ(with("0,0,0,0"), "m.csv:2: the quaternion qx,qy,qz,qw has the norm 0; it must be 1");
  EXPECT_EQ(with("0,0,0,1.1"),
            "m.csv:2: the quaternion qx,qy,qz,qw has the norm 1.1; it must be 1");
}

TEST_F(MotionCsv, TimesThatDontIncrease) {
  EXPECT_EQ(error("time,x,y,z\n0.5,0,0,0\n0.50,0,0,0\n"),
            "m.csv:3: time 0.50 doesn't come after 0.5 in the row before; times must strictly "
            "increase");
  EXPECT_EQ(error("time,x,y,z\n0,0,0,0\n2,0,0,0\n1,0,0,0\n"),
            "m.csv:4: time 1 doesn't come after 2 in the row before; times must strictly increase");
}

TEST_F(MotionCsv, RowsThatDontFitTheHeader) {
  EXPECT_EQ(error("time,x,y,z\n0,0,0\n"), "m.csv:2: has 3 fields; the header has 4 columns");
  EXPECT_EQ(error("time,x,y,z\n0,0,0,0\n1\n"), "m.csv:3: has 1 field; the header has 4 columns");
  EXPECT_EQ(error("time,x,y,z\n0,0,0,0\n\n1,0,0,0\n"),
            "m.csv:3: is a blank line between rows; leave it out");
}

TEST_F(MotionCsv, LongMotionsAreReadQuickly) {
  constexpr int kRows = 300'000;
  std::string content = "time,x,y,z,roll,pitch,yaw\n";
  for (int i = 0; i < kRows; ++i) {
    content += fmt::format("{:.2f},512340.123456,5403640.123456,431.123456,0.1,{:.6f},0.3\n",
                           i * 0.01, i * 1e-6);
  }
  const auto file = folder_.write("long.csv", content);
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(read_motion(file, std::nullopt).motion.times_s().size(), std::size_t{kRows});
  // A tenth of the three million rows that must not take a minute, on any build and machine.
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(6));
}

}  // namespace
}  // namespace soilvdb::io
