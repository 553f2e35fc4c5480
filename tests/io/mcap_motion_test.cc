// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Motions out of MCAP files that a script of its own makes: the same to the last bit as CSV files
// of the same numbers, whatever the files are like; and what is said of those that are damaged.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "soilvdb/io/motion_csv.h"
#include "soilvdb/io/motion_file.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace mcap_motion_test {

using ::testing::HasSubstr;

constexpr int kRows = 500;

Chain two_joints() {
  Chain chain;
  chain.joints = {{"boom", Joint::Type::kRevolute, {}, Vec3::UnitY(), -1, 1},
                  {"stick", Joint::Type::kPrismatic, {}, Vec3::UnitX(), 0, 2}};
  return chain;
}

/// A sensor's decimals: no number of them is a short one in binary.
std::string time_text(int row) {
  const std::int64_t ns = 12'345'678 + std::int64_t{row} * 1'000'003;
  return fmt::format("{}.{:09}", 1'700'000'000 + ns / 1'000'000'000, ns % 1'000'000'000);
}

std::string joints_csv(int rows = kRows) {
  std::string text = "time,wheel,stick,boom\n";
  for (int i = 0; i < rows; ++i)
    text += fmt::format("{},{},{},{}\n", time_text(i), i, 1 + std::sin(0.01 * i) / 3,
                        std::cos(0.02 * i) * 0.9);
  return text;
}

std::string poses_csv(int rows = kRows) {
  std::string text = "time,x,y,z,qx,qy,qz,qw\n";
  for (int i = 0; i < rows; ++i) {
    const double a = 0.01 * i;
    text += fmt::format("{},{},{},{},0,{:.6f},0,{:.6f}\n", time_text(i), 500000 + a / 3, 1e6 / 3,
                        std::sin(a), std::sin(a / 2), std::cos(a / 2));
  }
  return text;
}

void expect_same_bits(const Motion& a, const Motion& b) {
  const auto expect_same = [](double x, double y) {
    EXPECT_EQ(std::bit_cast<std::uint64_t>(x), std::bit_cast<std::uint64_t>(y)) << x << " " << y;
  };
  ASSERT_EQ(a.times_s().size(), b.times_s().size());
  for (std::size_t i = 0; i < a.times_s().size(); ++i) {
    expect_same(a.times_s()[i], b.times_s()[i]);
    const Pose p = a.row(i), q = b.row(i);
    for (int k = 0; k < 3; ++k) expect_same(p.position[k], q.position[k]);
    for (int k = 0; k < 4; ++k) expect_same(p.rotation.coeffs()[k], q.rotation.coeffs()[k]);
  }
}

class McapMotion : public ::testing::Test {
 protected:
  /// Makes `name` of motions in this folder, as tests/mcap/make_mcap.py has its arguments.
  std::filesystem::path make(const std::string& name, const std::string& arguments) const {
    const std::string command =
        fmt::format("cd '{}' && python3 '{}/tests/mcap/make_mcap.py' {} {}",
                    folder_.path().string(), SOILVDB_SOURCE_DIR, name, arguments);
    EXPECT_EQ(std::system(command.c_str()), 0) << command;
    return folder_ / name;
  }
  std::string bytes_of(const std::filesystem::path& file) const {
    std::stringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    return text.str();
  }
  std::string error(const MotionSource& source, const std::optional<Chain>& chain = {}) const {
    return test::message_of(folder_, [&] { read_motion(source, chain); });
  }
  MotionFile open(const MotionSource& source, const std::optional<Chain>& chain,
                  std::vector<std::string>& warnings, OnBadRow on_bad_row = OnBadRow::kStop) const {
    return {source,  chain, AngleUnit::kRadians, on_bad_row, [](const Motion&, std::int64_t) {},
            warnings};
  }

  const test::TempFolder folder_;
};

TEST_F(McapMotion, IsThatOfTheSameNumbersAsCsvHoweverTheFileIsPacked) {
  const MotionSource joints = folder_.write("joints.csv", joints_csv());
  const MotionSource poses = folder_.write("poses.csv", poses_csv());
  const Motion by_joints = read_motion(joints, two_joints()).motion;
  const Motion by_poses = read_motion(poses, std::nullopt).motion;
  int count = 0;
  for (const char* how :
       {"", "--chunk 7", "--chunk 50 --compression zstd", "--chunk 50 --compression lz4",
        "--chunk 1000 --compression zstd --big-endian", "--no-summary --idl",
        "--chunk 3 --no-crc --no-summary"}) {
    SCOPED_TRACE(how);
    const auto file =
        make(fmt::format("{}.mcap", ++count),
             fmt::format("{} joints:/joint_states:joints.csv string:/rosout:poses.csv "
                         "pose:/lip:poses.csv tf:/tf:map:lip:poses.csv",
                         how));
    const MotionInput read = read_motion({file, {"/joint_states"}}, two_joints());
    expect_same_bits(read.motion, by_joints);
    EXPECT_TRUE(read.warnings.empty());
    expect_same_bits(read_motion({file, {"/lip"}}, std::nullopt).motion, by_poses);
    expect_same_bits(read_motion({file, {"/tf", "lip"}}, std::nullopt).motion, by_poses);
    expect_same_bits(read_motion({file, {"/tf", "lip", "map"}}, std::nullopt).motion, by_poses);
  }
}

TEST_F(McapMotion, InPartsIsThatOfCsvInParts) {
  const int rows = static_cast<int>(2 * MotionFile::kPartSteps + 100);
  folder_.write("base.csv", "time,x,y,z,qx,qy,qz,qw\n1699999990,0,0,0,0,0,0,1\n");
  folder_.write("still.csv",
                "time,x,y,z,qx,qy,qz,qw\n1700000000,0,0,0,0,0,0,1\n1700000100,0,0,0,0,0,0,1\n");
  const MotionSource joints = folder_.write("joints.csv", joints_csv(rows));
  const MotionSource poses = folder_.write("poses.csv", poses_csv(rows));
  const auto file =
      make("m.mcap",
           "--chunk 999 --compression zstd joints:/joint_states:joints.csv "
           "pose:/lip:poses.csv tf:/tf:base:lip:poses.csv tf:/tf_static:map:site:base.csv "
           "tf:/tf:site:base:still.csv");
  std::vector<std::string> warnings;
  const auto expect_same = [&](const MotionFile& a, const MotionFile& b) {
    EXPECT_EQ(a.rows(), rows);
    ASSERT_EQ(a.parts(), b.parts());
    ASSERT_GE(a.parts(), 3U);
    for (std::size_t i = a.parts(); i-- > 0;) expect_same_bits(*a.part(i), *b.part(i));
  };
  expect_same(open({file, {"/joint_states"}}, two_joints(), warnings),
              open(joints, two_joints(), warnings));
  warnings.clear();
  expect_same(open({file, {"/lip"}}, {}, warnings), open(poses, {}, warnings));
  const MotionFile by_frames = open({file, {"/tf", "lip"}}, {}, warnings);
  const MotionFile by_poses = open(poses, {}, warnings);
  EXPECT_EQ(by_frames.rows(), rows);
  ASSERT_EQ(by_frames.parts(), by_poses.parts());
  for (std::size_t i = by_frames.parts(); i-- > 0;) {
    const auto a = by_frames.part(i), b = by_poses.part(i);
    ASSERT_EQ(a->times_s(), b->times_s());
    for (std::size_t k = 0; k < a->times_s().size(); k += 97)
      EXPECT_LT((a->row(k).position - b->row(k).position).norm(), 1e-9);
  }
  EXPECT_TRUE(warnings.empty());
}

TEST_F(McapMotion, ComposesTheWayUpWithSlowerFramesInBetween) {
  // The base goes along x at 1 m/s, told once in half a second, and the lip swings on it.
  std::string base = "time,x,y,z,qx,qy,qz,qw\n", lip = base;
  for (int i = 0; i <= 20; ++i) base += fmt::format("{},{},7,0,0,0,0,1\n", 100 + 0.5 * i, 0.5 * i);
  for (int i = 0; i <= 1000; ++i)
    lip += fmt::format("{:.9f},{},0,0,0,0,0,1\n", 100 + 0.01 * i, std::sin(0.01 * i));
  folder_.write("base.csv", base);
  folder_.write("lip.csv", lip);
  folder_.write("fixed.csv",
                "time,x,y,z,qx,qy,qz,qw\n0,0,0,2,0,0,0.70710678118654752,0.70710678118654752\n");
  const auto file = make("m.mcap",
                         "--chunk 100 tf:/tf:map:base:base.csv tf:/tf:turned:lip:lip.csv "
                         "tf:/tf_static:base:turned:fixed.csv");
  const Motion motion = read_motion({file, {"/tf", "lip"}}, std::nullopt).motion;
  ASSERT_EQ(motion.times_s().size(), 1001U);
  for (std::size_t i = 0; i <= 1000; i += 13) {
    const double s = 0.01 * static_cast<double>(i);
    EXPECT_LT((motion.row(i).position - Vec3(s, 7 + std::sin(s), 2)).norm(), 1e-12);
  }
  // Seen from the base the way ends earlier.
  const Motion from_base = read_motion({file, {"/tf", "lip", "base"}}, std::nullopt).motion;
  EXPECT_LT((from_base.row(50).position - Vec3(0, std::sin(0.5), 2)).norm(), 1e-12);
  EXPECT_THAT(error({file, {"/tf", "lip", "moon"}}),
              HasSubstr("m.mcap: frame 'lip' isn't below 'moon'; its chain is 'lip' on 'turned' on "
                        "'base' on 'map'"));
  EXPECT_THAT(error({file, {"/tf", "lop"}}),
              HasSubstr("no transform of frame 'lop'; did you mean 'lip'?"));
  EXPECT_THAT(error({file, {"/tf"}}), HasSubstr("say which is the bucket's frame"));
}

TEST_F(McapMotion, OfARecorderThatWasKilledIsWhatIsWhole) {
  folder_.write("poses.csv", poses_csv());
  const std::string whole =
      bytes_of(make("whole.mcap", "--chunk 50 --compression zstd pose:/lip:poses.csv"));
  const Motion all = read_motion({folder_ / "whole.mcap", {"/lip"}}, std::nullopt).motion;
  std::size_t last = 0;
  for (std::size_t size = 4000; size < whole.size() - 200; size += 611) {
    const MotionInput read =
        read_motion({folder_.write("torn.mcap", whole.substr(0, size)), {"/lip"}}, std::nullopt);
    const std::size_t rows = read.motion.times_s().size();
    EXPECT_EQ(rows % 50, 0U);
    EXPECT_GE(rows, last);
    EXPECT_EQ(read.motion.end_s(), all.times_s()[rows - 1]);
    ASSERT_EQ(read.warnings.size(), 1U);
    EXPECT_THAT(read.warnings[0],
                HasSubstr("torn.mcap: has no footer, as after a killed recorder"));
    last = rows;
  }
  EXPECT_GE(last, static_cast<std::size_t>(kRows - 50));
}

TEST_F(McapMotion, NoDamagedByteIsTakenForGood) {
  folder_.write("poses.csv", poses_csv(60));
  for (const char* how : {"", "--chunk 20", "--chunk 20 --compression lz4"}) {
    const std::string good =
        bytes_of(make("good.mcap", fmt::format("{} pose:/lip:poses.csv", how)));
    const Motion motion = read_motion({folder_ / "good.mcap", {"/lip"}}, std::nullopt).motion;
    const std::size_t data_end = good.rfind(std::string("\x0f\x04\0\0\0\0\0\0\0", 9));
    ASSERT_NE(data_end, good.npos);
    for (std::size_t at = 0; at < data_end; at += 37) {
      std::string bad = good;
      bad[at] = static_cast<char>(bad[at] ^ 0x10);
      const auto file = folder_.write("bad.mcap", bad);
      try {
        const MotionInput read = read_motion({file, {"/lip"}}, std::nullopt);
        // A record that goes on beyond the file is what a recorder that was killed leaves.
        EXPECT_EQ(read.warnings.size(), 1U) << at;
        const std::size_t rows = read.motion.times_s().size();
        for (std::size_t i = 0; i < rows; ++i)
          EXPECT_EQ(read.motion.times_s()[i], motion.times_s()[i]) << at;
      } catch (const InputError& e) {
        EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos);
      }
    }
  }
}

TEST_F(McapMotion, SaysWhatIsMissingAndWhatIsThere) {
  folder_.write("joints.csv", "time,wheel,boom\n0.5,1,0.25\n1,1,0.5\n");
  folder_.write("wheels.csv", "time,wheel\n0.5,1\n");
  folder_.write("poses.csv", poses_csv(3));
  const auto file = make("m.mcap",
                         "joints:/joint_states:joints.csv joints:/wheels:wheels.csv "
                         "string:/rosout:poses.csv pose:/lip:poses.csv");
  EXPECT_EQ(
      error({file, {"/joint_states"}}, two_joints()),
      "m.mcap: no message of topic '/joint_states' has joint 'stick'; the machine needs 'boom' and "
      "'stick', which may be of several topics: 'topic: [/a, /b]'");
  EXPECT_EQ(error({file, {"/wheels"}}, two_joints()),
            "m.mcap: no message of topic '/wheels' has a joint of the machine: 'boom' and 'stick'; "
            "they have 'wheel'");
  EXPECT_EQ(error({file, {"/joints"}}, two_joints()),
            "m.mcap: has no message of topic '/joints'; its topics are '/joint_states', '/lip', "
            "'/rosout' and '/wheels'");
  EXPECT_THAT(error({file, {"/joint_states"}}), HasSubstr("the machine needs a urdf"));
  EXPECT_THAT(error({file, {"/lip"}}, two_joints()),
              HasSubstr("name a topic of sensor_msgs/JointState"));
  EXPECT_THAT(error({file, {"/rosout"}}),
              HasSubstr("topic '/rosout' is of std_msgs/String; it must be of"));
  EXPECT_THAT(error({file, {"/lip", "lip"}}), HasSubstr("has no transforms; remove 'frame'"));
  EXPECT_THAT(error(MotionSource(file)),
              HasSubstr("m.mcap: is an MCAP file; say which topic of it"));
  EXPECT_THAT(error({folder_ / "poses.csv", {"/lip"}}),
              HasSubstr("poses.csv: is not an MCAP file"));
  const auto json = make("json.mcap", "--encoding json pose:/lip:poses.csv");
  EXPECT_EQ(error({json, {"/lip"}}),
            "json.mcap: topic '/lip' is encoded as 'json'; it must be cdr, as ROS 2 records it");
}

TEST_F(McapMotion, HasItsRowsCheckedAsThoseOfCsv) {
  // Another machine's messages in between, a row beyond the stop, a time that goes back.
  const MotionSource csv = folder_.write(
      "joints.csv", "time,boom,stick\n0,0.1,1\n1,0.2,1\n2,1.5,1\n3,0.3,1\n2.5,0.3,1\n4,0.4,1\n");
  folder_.write("other.csv", "time,wheel\n0.5,0\n1.5,7\n");
  const auto file = make("m.mcap", "joints:/joint_states:joints.csv");
  std::vector<std::string> csv_warnings, warnings;
  const MotionFile by_csv = open(csv, two_joints(), csv_warnings, OnBadRow::kSkip);
  const MotionFile by_mcap =
      open({file, {"/joint_states"}}, two_joints(), warnings, OnBadRow::kSkip);
  EXPECT_EQ(by_csv.rows(), 4);
  EXPECT_EQ(by_csv.bad_rows().count, 2);
  // Its messages are in the order of time.
  EXPECT_EQ(by_mcap.rows(), 5);
  EXPECT_EQ(by_mcap.bad_rows().count, 1);
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_THAT(warnings[0], HasSubstr("m.mcap:3: joint boom is at 1.5 rad; the urdf limits it to -1 "
                                     "to 1"));
  EXPECT_THAT(error({file, {"/joint_states"}}, two_joints()),
              HasSubstr("m.mcap:3: joint boom is at"));
  const auto both = make("both.mcap", "joints:/j:joints.csv joints:/j:other.csv");
  std::vector<std::string> both_warnings;
  EXPECT_EQ(open({both, {"/j"}}, two_joints(), both_warnings, OnBadRow::kSkip).rows(), 5);
}

}  // namespace mcap_motion_test
}  // namespace soilvdb::io
