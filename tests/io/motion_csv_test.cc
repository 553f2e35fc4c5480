// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What is read from a motion, and the one line said about each way to get it wrong.
#include "soilvdb/io/motion_csv.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <ctime>
#include <numbers>

#include "tests/io/motion_csv_fixture.h"

namespace soilvdb::io {
namespace motion_csv_test {

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

TEST_F(MotionCsv, TimesMayBeDates) {
  const auto motion = read(
                          "time,x,y,z\n2026-05-01T07:00:00Z,0,0,0\n"
                          "2026-05-01T09:00:00.25+02:00,0.1,0,0\n1777618800.5,0.2,0,0\n")
                          .motion;
  EXPECT_EQ(motion.times_s(), (std::vector<double>{1777618800, 1777618800.25, 1777618800.5}));
  EXPECT_EQ(error("time,x,y,z\n2026-05-01T07:00:00,0,0,0\n"),
            "m.csv:2: time: '2026-05-01T07:00:00' has no offset from UTC, such as Z or +02:00; a "
            "time in ISO 8601 is such as 2026-05-01T07:00:00.25+02:00");
  EXPECT_EQ(error("time,x,y,z\n0,2026-05-01T07:00:00Z,0,0\n"),
            "m.csv:2: x is '2026-05-01T07:00:00Z'; it must be a number");
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
  EXPECT_EQ(
      error("time,x,y,z\n0,0,0,0\n1,4.9e-324,0,0\n"),
      "m.csv:3: x is 4.9e-324, too small for any sensor; it must be 0 or a number beyond 1e-300");
  EXPECT_EQ(error("time,x,y,z\n0,0,0,0\n1e-310,0,0,0\n").substr(0, 23), "m.csv:3: time is 1e-310");
  EXPECT_EQ(error("time,x,y,z\n0,0,0,0\n1,1e-400,0,0\n"),
            "m.csv:3: x is '1e-400'; it must be a number");
}

TEST_F(MotionCsv, AHeaderThatIsMissing) {
  EXPECT_EQ(error("0,0,0,0\n1,1,0,0\n"),
            "m.csv:1: begins with numbers; the first line must name the columns: time,x,y,z and so "
            "on");
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
  EXPECT_EQ(error("time,x,y,z\n0.5,0,0,0\n0.50,0,0,0.1\n"),
            "m.csv:3: time 0.50 doesn't come after 0.5 in the row before, and other values differ; "
            "two rows of one time must be the same");
  EXPECT_EQ(error("time,x,y,z\n0.5,0,0,0\n0.50,0,0,0\n"), "nothing thrown");
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
  const std::clock_t start = std::clock();
  EXPECT_EQ(read_motion(file, std::nullopt).motion.times_s().size(), std::size_t{kRows});
  // A tenth of the three million rows that must not take a minute.
  EXPECT_LT(std::clock() - start, test::cpu_s(6));
}

}  // namespace motion_csv_test
}  // namespace soilvdb::io
