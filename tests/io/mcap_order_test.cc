// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Messages out of order, in several files, from several senders, with and without stamps: the rows
// are those of the same numbers in order.
#include <algorithm>
#include <numbers>
#include <random>

#include "io/mcap/cdr.h"
#include "soilvdb/io/scenario.h"
#include "tests/support/mcap_fixture.h"

namespace soilvdb::io {
namespace mcap_order_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int kRows = 60;

Chain swing_and_slide() {
  Chain chain;
  chain.joints = {{"swing", Joint::Type::kContinuous, {}, Vec3::UnitZ()},
                  {"slide", Joint::Type::kPrismatic, {}, Vec3::UnitX(), 0, 9}};
  return chain;
}

TEST(Cdr, ATextWithAZeroWithinIsRefused) {
  using namespace std::string_view_literals;
  CdrWriter good, bad;
  good.put("boom"sv);
  bad.put("bo\0m"sv);  // two names where names end with zeros
  EXPECT_EQ(CdrReader(good.bytes()).text(), "boom");
  EXPECT_THROW(CdrReader(bad.bytes()).text(), CdrError);
}

class McapOrder : public RecordedMotion {
 protected:
  static Vec3 place(double s) { return {s, 2 * s, -s}; }
  void expect_all(const Read& read) const {
    EXPECT_EQ(read.bad.count, 0) << read.bad.first;
    ASSERT_EQ(read.times_s.size(), static_cast<std::size_t>(kRows));
    for (int i = 0; i < kRows; ++i) {
      EXPECT_DOUBLE_EQ(read.times_s[i], 10 + 0.1 * i);
      EXPECT_LT((read.positions[i] - place(0.1 * i)).norm(), 1e-9);
    }
  }
  /// Poses in that order, so many to a chunk; 0: all in one.
  std::filesystem::path poses(const std::string& name, const std::vector<int>& order,
                              std::size_t chunk = 0) const {
    return record(name, [&](Recording& r) {
      for (std::size_t k = 0; k < order.size(); ++k) {
        if (chunk > 0 && k > 0 && k % chunk == 0) r.chunk();
        r.pose("/lip", 10 + 0.1 * order[k], place(0.1 * order[k]));
      }
    });
  }
  static std::vector<int> numbers(int first = 0, int end = kRows) {
    std::vector<int> all;
    for (int i = first; i < end; ++i) all.push_back(i);
    return all;
  }
};

TEST_F(McapOrder, OfRecordsAndChunksInAFileDoesntMatter) {
  std::vector<int> order = numbers();
  std::reverse(order.begin(), order.end());
  expect_all(read({poses("back.mcap", order), {"/lip"}}));
  expect_all(read({poses("chunks_back.mcap", order, 7), {"/lip"}}));
  std::mt19937 random(1);
  for (const std::size_t chunk : {0, 1, 5, 50}) {
    std::shuffle(order.begin(), order.end(), random);
    expect_all(read({poses("mixed.mcap", order, chunk), {"/lip"}}));
  }
  order = numbers();
  std::rotate(order.begin(), order.begin() + 25, order.end());
  expect_all(read({poses("later_first.mcap", order, 10), {"/lip"}}));
}

TEST_F(McapOrder, OfJointsIsThatOfTheirStamps) {
  const auto file = record("joints.mcap", [&](Recording& r) {
    for (int i = 0; i < kRows; ++i) {
      const int k = i ^ 1;  // each pair swapped, and recorded in that order
      if (i % 9 == 0) r.chunk();
      r.joints("/j", 0.1 * k, {"slide", "swing"}, {0.1 * k, 0}, 0.1 * i);
    }
  });
  const Read read_joints = read({file, {"/j"}}, swing_and_slide());
  EXPECT_EQ(read_joints.bad.count, 0);
  ASSERT_EQ(read_joints.times_s.size(), static_cast<std::size_t>(kRows));
  for (int i = 0; i < kRows; ++i) EXPECT_DOUBLE_EQ(read_joints.positions[i].x(), 0.1 * i);
}

TEST_F(McapOrder, OfPartsDoesntMatter) {
  poses("a.mcap", numbers(0, 20));
  poses("b.mcap", numbers(20, 45), 6);
  poses("c.mcap", numbers(45));
  for (const auto& [first, second, third] :
       {std::array{"a", "b", "c"}, std::array{"c", "a", "b"}, std::array{"b", "c", "a"}}) {
    const auto file = [&](const char* name) { return folder_ / (name + std::string(".mcap")); };
    MotionSource source(file(first), {"/lip"});
    source.more_files = {file(second), file(third)};
    expect_all(read(source));
  }
  MotionSource two(folder_ / "a.mcap", {"/lip"});
  two.more_files = {record("d.mcap", [](Recording& r) { r.pose("/lip", 14, {500, 0, 0}); })};
  EXPECT_THAT(error(two), HasSubstr("d.mcap:1: the bucket moves 4")) << "its own file is named";
}

TEST_F(McapOrder, OfAFolderIsThatOfAListOfItsFiles) {
  std::filesystem::create_directory(folder_ / "bag");
  poses("bag/bag_0.mcap", numbers(0, 30));
  poses("bag/bag_1.mcap", numbers(30));
  folder_.write("bag/metadata.yaml", "rosbag2_bagfile_information: {storage_identifier: mcap}\n");
  const auto scenario = [&](const std::string& mcap) {
    return folder_.write("s.yaml",
                         "soilvdb: 1\nvoxel_size: 0.05\nterrain: {plane: {z: 0}}\nmachines:\n"
                         "  - {name: a, bucket: {width: 1, height: 1}, motion: {mcap: " +
                             mcap + ", topic: /lip}}\n");
  };
  for (const std::string mcap : {"bag", "bag/", "[bag/bag_1.mcap, bag/bag_0.mcap]"}) {
    SCOPED_TRACE(mcap);
    const Scenario read = read_scenario(scenario(mcap));
    EXPECT_EQ(read.machines[0].motion.rows(), kRows);
    std::vector<std::filesystem::path> inputs = read.inputs;
    std::sort(inputs.begin(), inputs.end());
    EXPECT_EQ(inputs.size(), 2U);
    EXPECT_EQ(inputs.front().filename(), "bag_0.mcap");
    EXPECT_TRUE(read.machines[0].motion.is_from(inputs.front()));
    EXPECT_TRUE(read.machines[0].motion.is_from(inputs.back()));
  }
  const auto refused = [&](const std::string& mcap) {
    return test::message_of(folder_, [&] { read_scenario(scenario(mcap)); });
  };
  std::filesystem::create_directory(folder_ / "empty");
  EXPECT_EQ(refused("empty"),
            "s.yaml:5: mcap: empty: is a folder without .mcap files; name one with some");
  EXPECT_EQ(refused("[]"), "s.yaml:5: mcap is an empty list; it must have an entry");
  EXPECT_EQ(refused("[bag, gone.mcap]"), "s.yaml:5: mcap: gone.mcap: no such file");
}

TEST_F(McapOrder, OfRecordingsInSqliteHasToBecomeMcapFirst) {
  const std::string sqlite("SQLite format 3\0", 16);
  std::filesystem::create_directory(folder_ / "old bag");
  folder_.write("old bag/bag_0.db3", sqlite);
  const auto refused = [&](const std::string& motion) {
    const auto file =
        folder_.write("s.yaml",
                      "soilvdb: 1\nvoxel_size: 0.05\nterrain: {plane: {z: 0}}\nmachines:\n"
                      "  - {name: a, bucket: {width: 1, height: 1}, motion: " +
                          motion + "}\n");
    return test::message_of(folder_, [&] { read_scenario(file); });
  };
  EXPECT_EQ(refused("{mcap: old bag, topic: /tf}"),
            "s.yaml:5: mcap: old bag: is a rosbag2 recording in sqlite3; make one in MCAP of it: "
            "ros2 bag convert -i 'old bag' -o to_mcap.yaml, where to_mcap.yaml says 'output_bags: "
            "[{uri: old bag_mcap, storage_id: mcap, all: true}]'");
  const std::string of_file =
      "is a rosbag2 recording in sqlite3; make one in MCAP of it: ros2 bag "
      "convert -i bag_0.db3 -o to_mcap.yaml";
  EXPECT_THAT(refused("{mcap: old bag/bag_0.db3, topic: /tf}"), HasSubstr(of_file));
  EXPECT_THAT(refused("old bag/bag_0.db3"), HasSubstr(of_file));
  EXPECT_THAT(refused("old bag"), HasSubstr("s.yaml:5: motion: old bag: is a folder; name a file, "
                                            "or say which topic of the .mcap files in it"));
}

TEST_F(McapOrder, OfASenderWhoseClockWasSetIsTold) {
  const auto file = record("clock.mcap", [&](Recording& r) {
    // Back by 2.05 s after 4 s, and so slow that the motion alone doesn't tell.
    for (int i = 0; i < kRows; ++i)
      r.pose("/lip", 10 + 0.1 * i - (i < 40 ? 0 : 2.05), place(0.001 * i), "map", 10 + 0.1 * i);
  });
  const Read set = read({file, {"/lip"}});
  EXPECT_GT(set.bad.count, 15);
  EXPECT_THAT(set.bad.first, HasSubstr("a clock was set, or a stamp is wrong"));
}

TEST_F(McapOrder, OfTwoMessagesOfOneStampIsOnlySaidWhereTheyDiffer) {
  const auto file = record("twice.mcap", [&](Recording& r) {
    for (const int i : {0, 1, 1, 2, 2, 3})
      r.pose("/lip", 10 + 0.1 * i, {0.1 * i, 0, 0}),
          r.joints("/j", i, {"slide", "swing"}, {0.1 * i, 0});
    r.pose("/lip", 10.2, {0.3, 0, 0});
    r.joints("/j", 2, {"slide", "swing"}, {0.3, 0});
  });
  const Read by_pose = read({file, {"/lip"}});
  EXPECT_EQ(by_pose.times_s.size(), 4U);
  EXPECT_EQ(by_pose.bad.count, 1);
  EXPECT_THAT(by_pose.bad.first, HasSubstr("twice.mcap:7: time 10.200000000 doesn't come after "
                                           "10.200000000 in the row before, and other values "
                                           "differ"));
  const Read by_joints = read({file, {"/j"}}, swing_and_slide());
  EXPECT_EQ(by_joints.times_s.size(), 4U);
  EXPECT_EQ(by_joints.bad.count, 1);
  EXPECT_THAT(
      by_joints.bad.first,
      HasSubstr("twice.mcap:7: has other values of joint 'slide' at 2 s than a message before it"));
}

TEST_F(McapOrder, OfCsvRowsOfOneTimeIsOnlySaidWhereTheyDiffer) {
  const Read same =
      read(folder_.write("m.csv", "time,x,y,z\n0,1,0,0\n1,2,0,0\n1.0,2,0,0\n2,3,0,0\n"));
  EXPECT_EQ(same.bad.count, 0);
  EXPECT_THAT(same.times_s, ElementsAre(0, 1, 2));
  const Read other =
      read(folder_.write("m.csv", "time,x,y,z\n0,1,0,0\n1,2,0,0\n1,2.5,0,0\n2,3,0,0\n"));
  EXPECT_EQ(other.bad.count, 1);
  EXPECT_THAT(other.bad.first, HasSubstr("m.csv:4: time 1 doesn't come after 1 in the row before, "
                                         "and other values differ"));
}

TEST_F(McapOrder, OfJointsFromSeveralSendersIsThatOfTime) {
  // One tells of the swing at 10 Hz, the other of the slide at 4 Hz, on a topic each, or on one.
  for (const std::string second : {"/two", "/one"}) {
    const auto file = record("two.mcap", [&](Recording& r) {
      for (int i = 0; i <= 20; ++i) r.joints("/one", 0.1 * i, {"wheel", "swing"}, {7, 0.05 * i});
      r.chunk();
      for (int i = 0; i <= 8; ++i) r.joints(second, 0.25 * i, {"slide"}, {1 + 0.25 * i});
    });
    McapTopic topic{"/one"};
    topic.more_topics = {"/two"};
    const Read all = read({file, second == "/two" ? topic : McapTopic{"/one"}}, swing_and_slide());
    EXPECT_EQ(all.bad.count, 0);
    EXPECT_EQ(all.times_s.size(), 25U) << "21 and 9 times, 5 of them the same";
    for (std::size_t i = 0; i < all.times_s.size(); ++i) {
      const double s = all.times_s[i], x = 1 + s, a = 0.5 * s;
      // Between two samples a joint goes on evenly, as these do.
      EXPECT_LT((all.positions[i] - Vec3(x * std::cos(a), x * std::sin(a), 0)).norm(), 1e-9);
    }
  }
  EXPECT_THAT(error({folder_ / "two.mcap", {"/one"}},
                    [] {
                      Chain chain = swing_and_slide();
                      chain.joints[1].name = "stick";
                      return chain;
                    }()),
              HasSubstr("no message of topic '/one' has joint 'stick'; the machine needs 'swing' "
                        "and 'stick', which may be of several topics"));
}

TEST_F(McapOrder, OfAJointThatIsLostMakesBadRows) {
  const auto file = record("lost.mcap", [&](Recording& r) {
    for (int i = 0; i <= 40; ++i) {
      r.joints("/j", 0.1 * i, {"swing"}, {0.05 * i});
      if (i <= 10) r.joints("/j", 0.1 * i, {"slide"}, {1});
    }
  });
  const Read lost = read({file, {"/j"}}, swing_and_slide());
  EXPECT_EQ(lost.times_s.size(), 11U);
  EXPECT_EQ(lost.bad.count, 30);
  EXPECT_THAT(lost.bad.first, HasSubstr("joint 'slide' isn't known from 1 to 4 s"));
}

TEST_F(McapOrder, OfMessagesWithoutAStampIsThatOfTheirRecording) {
  const auto file = record("unstamped.mcap", [&](Recording& r) {
    for (int i = 0; i < kRows; ++i) r.pose("/lip", 0, place(0.1 * i), "map", 10 + 0.1 * i);
    for (int i = 0; i < 3; ++i) r.pose("/simulated", i, place(0.1 * i), "map", 1000 + i);
  });
  const Read unstamped = read({file, {"/lip"}});
  expect_all(unstamped);
  EXPECT_THAT(unstamped.warnings,
              ElementsAre(HasSubstr("60 messages of topic '/lip' have no stamp; the time at which "
                                    "they were recorded is taken")));
  // The first second of a simulation is one.
  const Read simulated = read({file, {"/simulated"}});
  EXPECT_THAT(simulated.times_s, ElementsAre(0, 1, 2));
  EXPECT_THAT(simulated.warnings, IsEmpty());
}

TEST_F(McapOrder, OfPosesSeenFromAnotherFrameIsTold) {
  const auto file = record("frames.mcap", [&](Recording& r) {
    for (int i = 0; i < kRows; ++i)
      r.pose("/lip", 10 + 0.1 * i, place(0.1 * i), i / 10 == 3 ? "odom" : "map");
  });
  const Read changed = read({file, {"/lip"}});
  EXPECT_EQ(changed.bad.count, 10);
  EXPECT_THAT(changed.bad.first, HasSubstr("frames.mcap:31: is seen from frame 'odom', and the "
                                           "first pose from 'map'"));
}

TEST_F(McapOrder, OfOdometryIsThatOfPoses) {
  expect_all(read({record("odometry.mcap",
                          [&](Recording& r) {
                            for (int i = 0; i < kRows; ++i)
                              r.odometry("/odom", 10 + 0.1 * i, place(0.1 * i));
                          }),
                   {"/odom"}}));
}

TEST_F(McapOrder, AGapAcrossWhichTheMachineMovedIsTold) {
  const auto poses_at = [&](const std::string& name, const std::vector<double>& times_s,
                            const Vec3& speed) {
    return read({record(name,
                        [&](Recording& r) {
                          for (const double s : times_s) r.pose("/lip", s, speed * s);
                        }),
                 {"/lip"}});
  };
  const std::vector<double> times_s = {0, 0.1, 0.2, 1.4, 1.5, 4.5, 4.6, 4.7, 4.8};
  const Read moved = poses_at("moved.mcap", times_s, {0.1, 0, 0});
  EXPECT_EQ(moved.bad.count, 0);
  EXPECT_EQ(moved.times_s.size(), times_s.size());
  ASSERT_EQ(moved.warnings.size(), 1U);
  EXPECT_THAT(moved.warnings[0],
              HasSubstr("moved.mcap:6: comes 3 s after the row before, the longest of 2 such gaps; "
                        "the machine moved meanwhile, and is assumed to have moved straight"));
  // Who publishes only what changes: it stood still, or nearly.
  EXPECT_THAT(poses_at("stood.mcap", times_s, {0.03, 0, 0}).warnings, IsEmpty());
  EXPECT_THAT(poses_at("often.mcap", {0, 0.1, 0.2, 1.1, 1.2}, {0.3, 0, 0}).warnings, IsEmpty());
  EXPECT_THAT(poses_at("seldom.mcap", {0, 2, 4, 9.9, 12}, {0.3, 0, 0}).warnings, IsEmpty());
  const auto turned = record("turned.mcap", [&](Recording& r) {
    for (const double s : times_s) r.joints("/j", s, {"slide", "swing"}, {0, 0.2 * s});
  });
  const Read joints = read({turned, {"/j"}}, swing_and_slide());
  ASSERT_EQ(joints.warnings.size(), 1U);
  EXPECT_THAT(joints.warnings[0], HasSubstr("turned.mcap:6: comes 3 s after the row before"));
}

TEST_F(McapOrder, OfABrokenMessageIsThatOfTheOneBefore) {
  const auto file = record("broken.mcap", [&](Recording& r) {
    for (int i = 0; i < 10; ++i) {
      r.pose("/lip", 10 + 0.1 * i, place(0.1 * i));
      if (i == 4) r.bytes("/lip", 10.41, "no CDR");
    }
  });
  const Read broken = read({file, {"/lip"}});
  EXPECT_EQ(broken.times_s.size(), 10U);
  EXPECT_EQ(broken.bad.count, 1);
  EXPECT_NEAR(*broken.bad.good_s, 10.4, 1e-9);
  EXPECT_THAT(broken.bad.first,
              HasSubstr("broken.mcap:6: is not a geometry_msgs/PoseStamped in CDR"));
}

TEST_F(McapOrder, OfASwingThatWrapsIsTheShortWayBetweenMessagesOfAnother) {
  const auto angle = [](double s) { return std::numbers::pi + 0.5 * (s - 0.25) + 0.001; };
  const auto file = record("two.mcap", [&](Recording& r) {
    for (int i = 0; i <= 10; ++i)
      r.joints("/one", 0.1 * i, {"swing"}, {std::remainder(angle(0.1 * i), 2 * std::numbers::pi)});
    r.chunk();
    for (int i = 0; i <= 4; ++i) r.joints("/one", 0.25 * i, {"slide"}, {1});
  });
  const Read all = read({file, {"/one"}}, swing_and_slide());
  EXPECT_EQ(all.bad.count, 0);
  ASSERT_EQ(all.times_s.size(), 13U) << "11 and 5 times, 3 of them the same";
  for (std::size_t i = 0; i < all.times_s.size(); ++i) {
    const double a = angle(all.times_s[i]);
    EXPECT_LT((all.positions[i] - Vec3(std::cos(a), std::sin(a), 0)).norm(), 1e-9);
  }
}

TEST_F(McapOrder, OfASwingThatWrapsIsFollowedOn) {
  // Three turns, told within half a turn either way, in parts that begin anywhere.
  const auto angle = [](int i) { return 0.1 * i; };
  const auto file = record("swing.mcap", [&](Recording& r) {
    for (int i = 0; i <= 190; ++i)
      r.joints("/j", 0.1 * i, {"swing", "slide"},
               {std::remainder(angle(i), 2 * std::numbers::pi), 1});
  });
  MotionReader reader({file, {"/j"}}, swing_and_slide());
  std::vector<RowMark> marks;
  for (int i = 0; i <= 180; i += 10) {
    marks.push_back(reader.mark());
    const Motion part = reader.next(10);
    EXPECT_NEAR(part.joint_values()[0], angle(i), 1e-9);
    EXPECT_NEAR(part.joint_values()[20], angle(i + 10), 1e-9);
  }
  EXPECT_EQ(reader.bad_rows().count, 0);
  EXPECT_THAT(reader.warnings(), IsEmpty());
  reader.go_to(marks[15]);
  EXPECT_NEAR(reader.next(10).joint_values()[0], angle(150), 1e-9);
}

}  // namespace mcap_order_test
}  // namespace soilvdb::io
