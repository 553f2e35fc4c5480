// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What messages of ROS 2 say at which stamp, and how long a state waits for it.
#include "tools/serve/ros_states.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "io/mcap/cdr.h"
#include "soilvdb/io/error.h"

namespace soilvdb::tools {
namespace ros_states_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr std::int64_t kMs = 1'000'000, kHost = 5'000'000 * kMs;

/// A chain of two joints: one that goes round, and one of a length.
Chain arm() {
  Joint turn;
  turn.name = "turn";
  turn.type = Joint::Type::kContinuous;
  Joint slide;
  slide.name = "slide";
  slide.type = Joint::Type::kPrismatic;
  return {{}, {turn, slide}, {}};
}

io::CdrWriter head(std::int64_t ms, std::string_view frame) {
  io::CdrWriter cdr;
  cdr.put_all(static_cast<std::int32_t>(ms / 1000), static_cast<std::uint32_t>(ms % 1000 * kMs));
  cdr.put(frame);
  return cdr;
}

std::string joints(std::int64_t ms, const std::vector<std::pair<std::string, double>>& all) {
  io::CdrWriter cdr = head(ms, "");
  cdr.put(static_cast<std::uint32_t>(all.size()));
  for (const auto& [name, value] : all) cdr.put(std::string_view(name));
  cdr.put(static_cast<std::uint32_t>(all.size()));
  for (const auto& [name, value] : all) cdr.put(value);
  cdr.put_all(std::uint32_t{0}, std::uint32_t{0});
  return cdr.bytes();
}

std::string transform(std::int64_t ms, std::string_view parent, std::string_view child, double x,
                      double qw = 1) {
  io::CdrWriter cdr;
  cdr.put(std::uint32_t{1});
  cdr.put_all(static_cast<std::int32_t>(ms / 1000), static_cast<std::uint32_t>(ms % 1000 * kMs));
  cdr.put(parent);
  cdr.put(child);
  cdr.put_all(x, 0.0, 0.0, 0.0, 0.0, 0.0, qw);
  return cdr.bytes();
}

std::string pose(std::int64_t ms, std::string_view frame, double x) {
  io::CdrWriter cdr = head(ms, frame);
  cdr.put_all(x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0);
  return cdr.bytes();
}

/// Messages by topic, at times of a clock that the test sets.
struct Listener {
  explicit Listener(io::McapTopic topic, std::optional<Chain> chain = {})
      : states({{7, "digger", std::move(topic), std::move(chain)}}) {}

  std::vector<std::size_t> take(const std::string& topic, const std::string& cdr) {
    for (std::size_t i = 0; i < states.inputs().size(); ++i)
      if (states.inputs()[i].topic == topic)
        return states.take(i, states.inputs()[i].types.back(), cdr, now_ms * kMs, kHost);
    ADD_FAILURE() << "it doesn't listen to " << topic;
    return {};
  }
  std::vector<RosStates::State> made() { return states.states(now_ms * kMs); }
  std::string fault() {
    const auto faults = states.take_faults();
    EXPECT_LE(faults.size(), 1u);
    return faults.empty() ? "" : faults.front().why;
  }

  RosStates states;
  std::int64_t now_ms = 0;
};

TEST(RosStates, JointsOfSeveralTopicsAreInterpolatedAtEachStamp) {
  Listener listener({"/a", {}, {}, {}, {"/b"}, {}}, arm());
  EXPECT_THAT(listener.take("/a", joints(1000, {{"turn", 3.0}})), ElementsAre(7u));
  EXPECT_THAT(listener.made(), IsEmpty()) << "the other joint isn't known";
  listener.take("/b", joints(1000, {{"slide", 1.0}, {"other", 9.0}}));
  auto made = listener.made();
  ASSERT_THAT(made, SizeIs(1));
  EXPECT_THAT(made[0].joints, ElementsAre(3.0, 1.0));
  EXPECT_FALSE(made[0].pose);
  listener.take("/a", joints(1100, {{"turn", -3.0}}));
  EXPECT_THAT(listener.made(), IsEmpty());
  listener.take("/b", joints(1400, {{"slide", 2.0}}));
  made = listener.made();
  ASSERT_THAT(made, SizeIs(1)) << "the stamp of /b waits for /a";
  EXPECT_EQ(made[0].time_ns, 1100 * kMs);
  EXPECT_THAT(made[0].joints, ElementsAre(-3.0, 1.25));
  listener.take("/a", joints(1500, {{"turn", 3.0}}));
  made = listener.made();
  ASSERT_THAT(made, SizeIs(1));
  // The short way round, from -3 to 3, of which three quarters are done.
  EXPECT_NEAR(made[0].joints[0], -3.0 + 0.75 * (6.0 - 2 * M_PI), 1e-12);
  EXPECT_EQ(made[0].joints[1], 2.0);
  EXPECT_EQ(listener.fault(), "");
}

TEST(RosStates, AStateWaitsAQuarterOfASecondAndThenTakesAValueThatIsNotOlder) {
  Listener listener({"/a", {}, {}, {}, {"/b"}, {}}, arm());
  listener.take("/a", joints(1000, {{"turn", 1.0}, {"slide", 1.0}}));
  ASSERT_THAT(listener.made(), SizeIs(1));
  listener.take("/a", joints(1200, {{"turn", 2.0}}));
  listener.now_ms = 250;
  EXPECT_THAT(listener.made(), IsEmpty());
  listener.now_ms = 251;
  auto made = listener.made();
  ASSERT_THAT(made, SizeIs(1));
  EXPECT_THAT(made[0].joints, ElementsAre(2.0, 1.0));
  listener.take("/a", joints(1300, {{"turn", 2.5}}));
  EXPECT_THAT(listener.made(), IsEmpty());
  listener.now_ms = 600;
  EXPECT_THAT(listener.made(), IsEmpty());
  EXPECT_EQ(listener.fault(),
            "joint 'slide' isn't known at 1.300000000 s: its last value is of 1.000000000 s");
}

TEST(RosStates, GapsOfMoreThanASecondAreNotBridged) {
  Listener listener({"/a", {}, {}, {}, {"/b"}, {}}, arm());
  listener.take("/b", joints(1000, {{"slide", 1.0}}));
  listener.take("/a", joints(1000, {{"turn", 1.0}}));
  ASSERT_THAT(listener.made(), SizeIs(1));
  listener.take("/a", joints(1500, {{"turn", 1.0}}));
  listener.take("/b", joints(2001, {{"slide", 1.0}}));
  EXPECT_THAT(listener.made(), IsEmpty());
  EXPECT_EQ(listener.fault(),
            "joint 'slide' isn't known at 1.500000000 s: at most one second is bridged, and its "
            "value before that is of 1.000000000 s");
}

TEST(RosStates, AnOlderStampMakesNoStateButAClockThatIsSetBackDoes) {
  Listener listener({"/a"}, arm());
  const auto at = [&](std::int64_t ms) {
    listener.take("/a", joints(ms, {{"turn", 1.0}, {"slide", 0.001 * static_cast<double>(ms)}}));
    return listener.made();
  };
  EXPECT_THAT(at(9000), SizeIs(1));
  EXPECT_THAT(at(9000), IsEmpty()) << "the same again";
  EXPECT_THAT(at(8500), IsEmpty()) << "late";
  EXPECT_THAT(at(9100), SizeIs(1));
  const auto made = at(2000);
  ASSERT_THAT(made, SizeIs(1));
  EXPECT_EQ(made[0].joints[1], 2.0);
  EXPECT_EQ(at(0)[0].time_ns, kHost) << "without a stamp";
}

TEST(RosStates, FramesNeedAWayToTheWorld) {
  Listener listener({"/tf", "bucket", "map"});
  EXPECT_THAT(listener.take("/tf", transform(1000, "arm", "bucket", 1)), ElementsAre(7u));
  listener.now_ms = 251;
  EXPECT_THAT(listener.made(), IsEmpty());
  EXPECT_EQ(listener.fault(),
            "frame 'bucket' isn't below 'map' so far; its chain is 'bucket' on 'arm'");
  listener.take("/tf", transform(1000, "map", "arm", 10));
  listener.take("/tf", transform(1100, "arm", "bucket", 2));
  EXPECT_THAT(listener.made(), IsEmpty()) << "where the arm is then isn't known yet";
  EXPECT_THAT(listener.take("/tf", transform(1200, "map", "arm", 12)), IsEmpty());
  const auto made = listener.made();
  ASSERT_THAT(made, SizeIs(1));
  EXPECT_EQ(made[0].machine, 7u);
  EXPECT_NEAR(made[0].pose->position.x(), 2 + 11, 1e-12);
  listener.take("/tf", transform(1300, "map", "arm", 12, 0.5));
  EXPECT_THAT(listener.fault(), HasSubstr("the transform of frame 'arm' has numbers that aren't"));
  EXPECT_THAT(listener.take("/tf", transform(1300, "map", "elsewhere", 12, 0.5)), IsEmpty());
  EXPECT_EQ(listener.fault(), "") << "frames that aren't on the way don't matter";
}

TEST(RosStates, AFrameIsWhereItsLatestParentIs) {
  Listener listener({"/tf", "bucket", "map"});
  const auto at = [&](std::int64_t ms, std::string_view parent, double x) {
    listener.take("/tf", transform(ms, parent, "bucket", x));
    const auto made = listener.made();
    return made.empty() ? NAN : made.back().pose->position.x();
  };
  listener.take("/tf_static", transform(0, "map", "left", 100));
  listener.take("/tf_static", transform(0, "map", "right", 200));
  EXPECT_EQ(at(1000, "left", 1), 101);
  EXPECT_EQ(at(1100, "right", 2), 202);
  EXPECT_TRUE(std::isnan(at(1050, "left", 3))) << "late, of a parent before";
  EXPECT_EQ(at(1200, "right", 4), 204);
  EXPECT_EQ(at(1300, "map", 5), 5);
  // Between two stamps with other parents nothing is interpolated.
  EXPECT_EQ(at(1500, "left", 6), 106);
  // A fixed frame may move on, too.
  listener.take("/tf_static", transform(1550, "right", "left", 1000));
  EXPECT_EQ(at(1600, "left", 7), 1207);
  // Nor further up, where a late message changes nothing.
  listener.take("/tf", transform(1700, "right", "arm", 20));
  EXPECT_EQ(at(1700, "arm", 0), 220);
  listener.take("/tf", transform(1900, "map", "arm", 30));
  listener.take("/tf", transform(1750, "right", "arm", 20));
  EXPECT_EQ(at(1800, "arm", 0), 30);
  EXPECT_EQ(listener.fault(), "");
  // After a clock was set back, its parents count.
  EXPECT_EQ(at(100, "right", 8), 208);
}

TEST(RosStates, FramesOfOthersHideNoneOfOurs) {
  for (const bool fixed : {false, true}) {
    SCOPED_TRACE(fixed);
    Listener listener({"/tf", "lip", "map"});
    const auto others = [&](int from) {
      for (int i = from; i < from + 11'000; ++i)
        listener.take(fixed ? "/tf_static" : "/tf",
                      transform(1000, "z_world", "z_" + std::to_string(i), 1));
    };
    const std::string world = fixed ? "map" : "here";
    if (!fixed) listener.take("/tf_static", transform(0, "map", world, 100));
    others(0);
    // From the world down, so that nobody knows at first what they are for.
    for (int round = 0; round < 3; ++round) {
      listener.take("/tf", transform(1000 + 100 * round, world, "base", 1));
      listener.take("/tf", transform(1000 + 100 * round, "base", "arm", 2));
      listener.take("/tf", transform(1000 + 100 * round, "arm", "bucket", 3));
      listener.take("/tf_static", transform(0, "bucket", "lip", 4));
    }
    auto made = listener.made();
    ASSERT_FALSE(made.empty());
    EXPECT_EQ(made.back().pose->position.x(), fixed ? 10 : 110);
    others(20'000);
    listener.take("/tf", transform(1400, world, "base", 1));
    listener.take("/tf", transform(1400, "base", "arm", 2));
    listener.take("/tf", transform(1400, "arm", "bucket", 30));
    made = listener.made();
    ASSERT_THAT(made, SizeIs(1));
    EXPECT_EQ(made.back().pose->position.x(), fixed ? 37 : 137);
  }
}

TEST(RosStates, FixedFramesHoldAtAllTimes) {
  Listener listener({"/tf", "lip", "map"});
  listener.take("/tf_static", transform(0, "bucket", "lip", 0.5));
  listener.take("/tf_static", transform(0, "map", "odom", 100));
  listener.take("/tf", transform(1000, "odom", "bucket", 3));
  const auto made = listener.made();
  ASSERT_THAT(made, SizeIs(1)) << "the frame that moves makes states";
  EXPECT_EQ(made[0].pose->position.x(), 103.5);
}

TEST(RosStates, PosesStayInOneFrame) {
  Listener listener({"/pose"});
  EXPECT_THAT(listener.take("/pose", pose(1000, "map", 1)), ElementsAre(7u));
  EXPECT_THAT(listener.take("/pose", pose(1100, "odom", 1)), IsEmpty());
  EXPECT_EQ(listener.fault(),
            "topic '/pose' has a pose in frame 'odom', and those before it are in 'map'");
  EXPECT_THAT(listener.made(), SizeIs(1));
}

TEST(RosStates, AMotionThatCannotBeHeardIsRefused) {
  const auto why = [](io::McapTopic topic, std::optional<Chain> chain) -> std::string {
    try {
      Listener(std::move(topic), std::move(chain));
    } catch (const io::InputError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(why({"/tf", "bucket"}, {}), HasSubstr("as 'parent: map' beside 'frame'"));
  EXPECT_THAT(why({"/tf", "bucket", "map"}, arm()), HasSubstr("'frame' is that of a bucket"));
  EXPECT_THAT(why({"/a", {}, {}, {}, {"/b"}, {}}, {}),
              HasSubstr("several topics are for joints only"));
}

}  // namespace ros_states_test
}  // namespace soilvdb::tools
