// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Motions of machines that drive: the base beside the joints, in CSV and in recordings.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <numbers>
#include <random>
#include <string>

#include "soilvdb/io/motion_file.h"
#include "tests/support/mcap_fixture.h"

namespace soilvdb::io {
namespace base_motion_test {

using ::testing::HasSubstr;

constexpr double kRounding = 1e-9;  // m and rad

Chain two_joints() {
  Chain chain;
  chain.world_from_root = {{1, 2, 3}, from_rpy(0.1, 0.2, 0.3)};
  chain.joints = {{"boom", Joint::Type::kRevolute, {}, Vec3::UnitY(), -1, 1},
                  {"stick", Joint::Type::kPrismatic, {}, Vec3::UnitX(), 0, 4}};
  return chain;
}

struct Row {
  double time_s = 0, boom = 0, stick = 0;
  Vec3 position = Vec3::Zero(), rpy = Vec3::Zero();

  Pose base() const { return {position, from_rpy(rpy.x(), rpy.y(), rpy.z())}; }
  Pose bucket() const {
    Chain chain = two_joints();
    chain.world_from_root = base();
    return chain.world_from_bucket(std::array{boom, stick});
  }
};

std::vector<Row> rows(int count, std::uint64_t seed = 1) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> any(-1, 1);
  std::vector<Row> all;
  Row at{1'700'000'000, 0, 2, {500000, 5400000, 400}, Vec3::Zero()};
  for (int i = 0; i < count; ++i) {
    at.time_s = 1'700'000'000 + 0.01 * i;
    at.boom = 0.9 * std::sin(0.02 * i);
    at.stick = 2 + std::sin(0.01 * i) / 3;
    at.position += 0.02 * Vec3(1 + any(random), any(random), 0.1 * any(random));
    at.rpy += 0.02 * Vec3(0.1 * any(random), 0.1 * any(random), any(random));
    all.push_back(at);
  }
  return all;
}

std::string rpy_csv(const std::vector<Row>& all, double unit = 1) {
  std::string text = "time,boom,stick,base_x,base_y,base_z,base_roll,base_pitch,base_yaw\n";
  for (const Row& r : all)
    text += fmt::format("{:.2f},{},{},{},{},{},{},{},{}\n", r.time_s, r.boom / unit, r.stick,
                        r.position.x(), r.position.y(), r.position.z(), r.rpy.x() / unit,
                        r.rpy.y() / unit, r.rpy.z() / unit);
  return text;
}

/// @param prefix of the base's columns @param joints also those of the joints
std::string quaternion_csv(const std::vector<Row>& all, const std::string& prefix = "base_",
                           bool joints = true) {
  std::string text = fmt::format("time,{1}{0}x,{0}y,{0}z,{0}qx,{0}qy,{0}qz,{0}qw\n", prefix,
                                 joints ? "boom,stick," : "");
  for (const Row& r : all) {
    const auto v = row_of(r.base());
    text += fmt::format("{:.2f},", r.time_s);
    if (joints) text += fmt::format("{},{},", r.boom, r.stick);
    text += fmt::format("{},{},{},{:.6f},{:.6f},{:.6f},{:.6f}\n", v[0], v[1], v[2], v[3], v[4],
                        v[5], v[6]);
  }
  return text;
}

std::string joints_csv(const std::vector<Row>& all) {
  std::string text = "time,boom,stick\n";
  for (const Row& r : all) text += fmt::format("{:.2f},{},{}\n", r.time_s, r.boom, r.stick);
  return text;
}

void expect_same_bits(const Motion& a, const Motion& b) {
  ASSERT_EQ(a.times_s(), b.times_s());
  ASSERT_EQ(a.joint_values().size(), b.joint_values().size());
  for (std::size_t i = 0; i < a.joint_values().size(); ++i)
    ASSERT_EQ(a.joint_values()[i], b.joint_values()[i]) << i;
}

class BaseMotion : public RecordedMotion {
 protected:
  Motion csv(const std::string& text, AngleUnit unit = AngleUnit::kRadians) const {
    return read_motion(folder_.write("m.csv", text), two_joints(), unit).motion;
  }
  std::string csv_error(const std::string& text) const {
    return error(MotionSource(folder_.write("m.csv", text)), two_joints());
  }
  static MotionSource source(const std::filesystem::path& file, McapTopic base) {
    MotionSource all(file, {"/joint_states"});
    all.mcap.base = std::make_shared<McapTopic>(std::move(base));
    return all;
  }
};

TEST_F(BaseMotion, OfCsvIsThatOfChainsThatStandThereRowByRow) {
  const std::vector<Row> all = rows(200);
  const Motion by_angles = csv(rpy_csv(all)), by_quaternion = csv(quaternion_csv(all)),
               in_degrees = csv(rpy_csv(all, std::numbers::pi / 180), AngleUnit::kDegrees);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Pose wanted = all[i].bucket();
    EXPECT_LT((by_angles.row(i).position - wanted.position).norm(), kRounding);
    EXPECT_LT((in_degrees.row(i).position - wanted.position).norm(), 1e-8);
    EXPECT_LT((by_quaternion.row(i).position - wanted.position).norm(), 1e-5) << "six decimals";
    EXPECT_LT(
        (by_angles.row(i).rotation.toRotationMatrix() - wanted.rotation.toRotationMatrix()).norm(),
        kRounding);
  }
  // In between joints are even, and the base as a pose.
  for (std::size_t i = 1; i < all.size(); ++i) {
    const Row &a = all[i - 1], &b = all[i];
    Chain chain = two_joints();
    chain.world_from_root = interpolate(a.base(), b.base(), 0.25);
    const Pose wanted = chain.world_from_bucket(
        std::array{a.boom + 0.25 * (b.boom - a.boom), a.stick + 0.25 * (b.stick - a.stick)});
    const double time_s =
        by_angles.times_s()[i - 1] + 0.25 * (by_angles.times_s()[i] - by_angles.times_s()[i - 1]);
    // Times since 1970 are rounded to a part of a row.
    EXPECT_LT((by_angles.pose(time_s).position - wanted.position).norm(), 1e-5);
  }
}

TEST_F(BaseMotion, WithoutItsColumnsStandsWhereTheScenarioSays) {
  const Motion motion = csv(joints_csv(rows(5)));
  for (std::size_t i = 0; i < 5; ++i) {
    const Row r = rows(5)[i];
    EXPECT_EQ(motion.row(i).position,
              two_joints().world_from_bucket(std::array{r.boom, r.stick}).position);
  }
}

TEST_F(BaseMotion, SaysWhatIsWrongWithItsColumns) {
  const std::string joints = "time,boom,stick,", row = "\n0,0,1,0,0,0\n";
  EXPECT_THAT(csv_error(joints + "base_x,base_y" + row),
              HasSubstr("m.csv:1: column 'base_z' is missing; the pose of the machine's base needs "
                        "base_x,base_y,base_z"));
  EXPECT_THAT(csv_error(joints + "base_yaw" + row), HasSubstr("columns 'base_x', 'base_y'"));
  EXPECT_THAT(csv_error(joints + "base_x,base_y,base_z,base_qw" + row),
              HasSubstr("a quaternion needs base_qx,base_qy,base_qz,base_qw"));
  EXPECT_THAT(csv_error(joints + "base_x,base_y,base_z,base_yaw,base_qw" + row),
              HasSubstr("has both angles (base_roll, base_pitch, base_yaw) and a quaternion "
                        "(base_qx, base_qy, base_qz, base_qw); keep one"));
  // A joint may have such a name.
  Chain chain = two_joints();
  chain.joints[1].name = "base_x";
  const Motion motion =
      read_motion(folder_.write("m.csv", "time,boom,base_x\n0,0,1\n1,0,1\n"), chain).motion;
  EXPECT_EQ(motion.joint_values().size(), 4u);
}

TEST_F(BaseMotion, HasColumnsInLowerCase) {
  const MotionInput got = read_motion(
      folder_.write("m.csv", "time,boom,stick,Base_X,Base_Y,Base_Z\n0,0,1,0,0,0\n"), two_joints());
  ASSERT_EQ(got.warnings.size(), 1u);
  EXPECT_THAT(got.warnings[0],
              HasSubstr("ignored columns 'Base_X', 'Base_Y' and 'Base_Z'; did you mean 'base_x' by "
                        "'Base_X', 'base_y' by 'Base_Y', 'base_z' by 'Base_Z'?"));
}

TEST_F(BaseMotion, HasColumnsThatAreNoJoints) {
  Chain chain = two_joints();
  chain.joints[1].name = "base_x";
  EXPECT_THAT(
      error(MotionSource(folder_.write("m.csv", "time,boom,base_x,base_z\n0,0,1,0\n")), chain),
      HasSubstr("m.csv:1: 'base_z' is of the base's pose, and 'base_x' is a joint of the urdf; "
                "rename that joint"));
  chain.joints = {{"weld", Joint::Type::kFixed, {}}};
  EXPECT_THAT(
      error(MotionSource(folder_.write("m.csv", "time,base_x,base_y,base_z\n0,0,1,0\n")), chain),
      HasSubstr("m.csv:1: 'base_z' is of the base's pose, and no joint of the urdf moves the lip"));
}

TEST_F(BaseMotion, InDegreesIsDoubted) {
  std::string text = "time,boom,stick,base_x,base_y,base_z,base_yaw\n";
  for (int i = 0; i < 20; ++i) text += fmt::format("{},0,1,0,0,0,{}\n", i, 90 + 0.5 * i);
  const MotionInput got = read_motion(folder_.write("m.csv", text), two_joints());
  ASSERT_EQ(got.warnings.size(), 1u);
  EXPECT_THAT(got.warnings[0], HasSubstr("roll, pitch or yaw is beyond a turn in 20 rows, first "
                                         "at line 2; they must be in radians"));
}

TEST_F(BaseMotion, HasBadRowsWhereNoMachineDrives) {
  const auto bad = [&](const std::string& row) {
    const std::string head = "time,boom,stick,base_x,base_y,base_z,base_qx,base_qy,base_qz,base_qw";
    return csv_error(head + "\n0,0,1,0,0,0,0,0,0,1\n" + row + "\n");
  };
  EXPECT_THAT(
      bad("0.1,0,1,9,0,0,0,0,0,1"),
      HasSubstr("m.csv:3: the base moves 9 m in 0.1 s since the row before; no machine does "
                "more than 50 m/s"));
  EXPECT_THAT(bad("0.1,0,1,0,0,0,0,0,1,0"), HasSubstr("m.csv:3: the base turns 3.14 rad in 0.1 s"));
  EXPECT_THAT(
      bad("0.1,0,1,0,0,0,0,0,0,2"),
      HasSubstr("m.csv:3: the quaternion base_qx,base_qy,base_qz,base_qw has the norm 2; it "
                "must be 1"));
  EXPECT_THAT(bad("0.1,0,1,nan,0,0,0,0,0,1"), HasSubstr("m.csv:3: base_x is nan; it must be"));
  EXPECT_THAT(bad("0.1,0,1,1e300,0,0,0,0,0,1"), HasSubstr("m.csv:3: base_x is 1e300"));
  EXPECT_THAT(bad("0,0,1,0.01,0,0,0,0,0,1"), HasSubstr("two rows of one time must be the same"));
}

TEST_F(BaseMotion, OfRecordingsIsThatOfTheSameNumbersAsCsvInParts) {
  const std::vector<Row> all = rows(static_cast<int>(2 * MotionFile::kPartSteps + 300));
  folder_.write("joints.csv", joints_csv(all));
  folder_.write("tf.csv", quaternion_csv(all, "", false));
  const std::string command = fmt::format(
      "cd '{}' && python3 '{}/tests/mcap/make_mcap.py' m.mcap --chunk 999 --compression zstd "
      "joints:/joint_states:joints.csv tf:/tf:map:root:tf.csv pose:/root:tf.csv",
      folder_.path().string(), SOILVDB_SOURCE_DIR);
  ASSERT_EQ(std::system(command.c_str()), 0) << command;
  std::vector<std::string> warnings;
  const auto open = [&](const MotionSource& from) {
    return MotionFile(
        from, two_joints(), AngleUnit::kRadians, OnBadRow::kStop,
        [](const Motion&, std::int64_t) {}, warnings);
  };
  const MotionFile text = open(folder_.write("m.csv", quaternion_csv(all)));
  for (const McapTopic& base :
       {McapTopic{"/tf", "root", "map"}, McapTopic{"/tf", "root"}, McapTopic{"/root"}}) {
    const MotionFile recorded = open(source(folder_ / "m.mcap", base));
    EXPECT_EQ(recorded.rows(), text.rows());
    ASSERT_EQ(recorded.parts(), 3u);
    for (const std::size_t part : {0u, 2u, 1u}) {
      const auto a = recorded.part(part), b = text.part(part);
      expect_same_bits(*a, *b);
    }
  }
  EXPECT_TRUE(warnings.empty());
}

TEST_F(BaseMotion, OfRecordingsIsInterpolatedAtTheStampsOfTheJoints) {
  // The base drives 2 m/s along x and is sent five times a second, on a cart that stands at y 7.
  const auto file = record("m.mcap", [](Recording& to) {
    to.transform(0, "map", "cart", {0, 7, 0}, {}, "/tf_static");
    for (int i = 0; i <= 200; ++i) {
      if (i % 20 == 3) to.transform(100 + 0.01 * i, "cart", "root", {0.02 * i, 0, 0});
      to.joints("/joint_states", 100 + 0.01 * i, {"boom", "stick"}, {0, 1});
    }
  });
  const Read got = read(source(file, {"/tf", "root"}), two_joints());
  ASSERT_EQ(got.times_s.size(), 201u);
  EXPECT_EQ(got.bad.count, 0);
  for (std::size_t i = 0; i < got.times_s.size(); ++i) {
    // Before its first transform and after its last the base stands.
    const double driven_m = 0.02 * std::clamp(static_cast<double>(i), 3.0, 183.0);
    EXPECT_LT((got.positions[i] - Vec3(1 + driven_m, 7, 0)).norm(), kRounding) << i;
  }
}

TEST_F(BaseMotion, OfRecordingsIsUnknownInGapsAndBeyondItsEnds) {
  const auto file = record("m.mcap", [](Recording& to) {
    for (int i = 0; i <= 1000; ++i) {
      const bool sent = i >= 100 && i <= 900 && !(i > 400 && i < 600);
      if (sent) to.transform(100 + 0.01 * i, "map", "root", {0.001 * i, 0, 0});
      if (sent) to.pose("/pose", 100 + 0.01 * i, {0.001 * i, 0, 0});
      to.joints("/joint_states", 100 + 0.01 * i, {"boom", "stick"}, {0, 1});
    }
  });
  for (const McapTopic& base : {McapTopic{"/tf", "root"}, McapTopic{"/pose"}}) {
    const Read got = read(source(file, base), two_joints());
    for (const double time_s : got.times_s) {
      EXPECT_TRUE((time_s > 100.74 && time_s < 104.005) || (time_s > 105.995 && time_s < 109.26))
          << time_s;
    }
    EXPECT_EQ(got.times_s.size() + static_cast<std::size_t>(got.bad.count), 1001u);
    EXPECT_NEAR(static_cast<double>(got.bad.count), 75 + 199 + 75, 1);
    EXPECT_THAT(got.bad.first,
                HasSubstr("m.mcap:1: the base isn't known at 100.000000000 s: its first pose is at "
                          "101.000000000 s"));
  }
}

/// Rows of joints each 10 ms, and of the base each 50 ms but for a gap before the last.
TEST_F(BaseMotion, OfRecordingsIsKnownAsLongBehindAGapInAnyPart) {
  constexpr int kLast = static_cast<int>(MotionFile::kPartSteps) - 20, kGap = 90, kAfter = 25;
  const auto file = record("m.mcap", [](Recording& to) {
    for (int i = 0; i <= kLast + 130; ++i) {
      const double time_s = 100 + 0.01 * i;
      if ((i <= kLast - kGap && (kLast - kGap - i) % 5 == 0) || i == kLast) {
        to.transform(time_s, "map", "root", {0.001 * i, 0, 0});
        to.pose("/pose", time_s, {0.001 * i, 0, 0});
      }
      to.joints("/joint_states", time_s, {"boom", "stick"}, {0, 1});
    }
  });
  for (const McapTopic& base : {McapTopic{"/tf", "root"}, McapTopic{"/pose"}}) {
    std::vector<std::string> warnings;
    const MotionFile motion(
        source(file, base), two_joints(), AngleUnit::kRadians, OnBadRow::kSkip,
        [](const Motion&, std::int64_t) {}, warnings);
    ASSERT_EQ(motion.parts(), 2u);
    EXPECT_NEAR(motion.end_s(), 100 + 0.01 * (kLast + kAfter), 1e-6);
    for (const std::size_t part : {1u, 0u, 1u}) {
      const auto rows = motion.part(part);
      EXPECT_NEAR(rows->row(rows->times_s().size() - 1).position.x(), 1 + 0.001 * kLast, 0.1);
    }
  }
}

/// Its frame is sent each 4 s, and that below it each 50 ms.
TEST_F(BaseMotion, OfRecordingsMayBeSentSeldomOnAFrameThatIsSentOften) {
  constexpr int kLast = static_cast<int>(MotionFile::kPartSteps) + 130;
  const auto file = record("m.mcap", [](Recording& to) {
    for (int i = 0; i <= kLast; ++i) {
      const double time_s = 100 + 0.01 * i;
      if (i % 400 == 0 || i == kLast) to.transform(time_s, "cart", "root", {0.001 * i, 0, 0});
      if (i % 5 == 0) to.transform(time_s, "map", "cart", {0, 0.001 * i, 0});
      to.joints("/joint_states", time_s, {"boom", "stick"}, {0, 1});
    }
  });
  std::vector<std::string> warnings;
  const MotionFile motion(
      source(file, {"/tf", "root"}), two_joints(), AngleUnit::kRadians, OnBadRow::kStop,
      [](const Motion&, std::int64_t) {}, warnings);
  ASSERT_EQ(motion.parts(), 2u);
  EXPECT_NEAR(motion.part(1)->row(100).position.x(), 1 + 0.001 * (kLast - 30), 0.1);
}

TEST_F(BaseMotion, OfRecordingsThatContradictsItselfIsNotUsed) {
  const auto file = record("m.mcap", [](Recording& to) {
    for (int i = 0; i <= 100; ++i) {
      to.pose("/pose", 100 + 0.1 * i, {0.01 * i, 0, 0});
      if (i == 50) to.pose("/pose", 100 + 0.1 * i, {0.01 * i, 0.2, 0});
      if (i == 60) to.pose("/pose", 100 + 0.1 * i, {0.01 * i, 0, 0});
      to.joints("/joint_states", 100 + 0.1 * i, {"boom", "stick"}, {0, 1});
    }
  });
  const Read got = read(source(file, {"/pose"}), two_joints());
  EXPECT_EQ(got.bad.count, 1);
  EXPECT_THAT(got.bad.first, HasSubstr("the base isn't known at 105.000000000 s: its poses at that "
                                       "time contradict each other"));
  for (const Vec3& at : got.positions) EXPECT_LT(std::abs(at.y()), kRounding);
}

TEST_F(BaseMotion, OfRecordingsWithoutAGoodPoseSaysWhy) {
  const auto file = record("m.mcap", [](Recording& to) {
    for (int i = 0; i <= 100; ++i) {
      to.pose("/pose", 100 + 0.1 * i, {NAN, 0, 0});
      to.joints("/joint_states", 100 + 0.1 * i, {"boom", "stick"}, {0, 1});
    }
  });
  EXPECT_THAT(error(source(file, {"/pose"}), two_joints()), HasSubstr("x is nan; it must be"));
}

TEST_F(BaseMotion, OfRecordingsMayStand) {
  const auto file = record("m.mcap", [](Recording& to) {
    to.transform(0, "map", "root", {5, 6, 7}, {}, "/tf_static");
    to.transform(100, "root", "lidar", {0, 0, 1});
    for (int i = 0; i < 10; ++i)
      to.joints("/joint_states", 100 + 0.1 * i, {"boom", "stick"}, {0, 1});
  });
  for (const Vec3& at : read(source(file, {"/tf", "root"}), two_joints()).positions)
    EXPECT_LT((at - Vec3(6, 6, 7)).norm(), kRounding);
}

TEST_F(BaseMotion, OfRecordingsSaysWhatIsMissing) {
  const auto file = record("m.mcap", [](Recording& to) {
    for (int i = 0; i < 10; ++i) {
      to.transform(100 + 0.1 * i, "map", "root", {0.1 * i, 0, 0});
      to.joints("/joint_states", 100 + 0.1 * i, {"boom", "stick"}, {0, 1});
    }
  });
  const auto why = [&](const McapTopic& base) { return error(source(file, base), two_joints()); };
  EXPECT_THAT(why({"/tf", "rot"}),
              HasSubstr("has no transform of frame 'rot'; did you mean 'root'"));
  EXPECT_THAT(why({"/tf", "root", "world"}), HasSubstr("frame 'root' isn't below 'world'"));
  EXPECT_THAT(why({"/tf"}),
              HasSubstr("say which is the frame of the urdf's root, as 'frame: NAME' in "
                        "'base:'"));
  EXPECT_THAT(why({"/joint_states"}),
              HasSubstr("topic '/joint_states' has joints; a base needs transforms or poses"));
  EXPECT_THAT(why({"/odom"}), HasSubstr("has no message of topic '/odom'; its topics are"));
}

}  // namespace base_motion_test
}  // namespace soilvdb::io
