// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A machine that is placed digs nothing on its way; nothing of its soil is lost, nor of what it
// held.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "tests/session/session_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace session_place_test {

using ::testing::HasSubstr;

class Placed : public ::testing::TestWithParam<bool> {
 protected:
  static SessionSite site() { return site_of(GetParam() ? loam() : Earthmoving{}); }
  static Earthmoving loam() {
    Earthmoving all = moving();
    all.pours.clear();
    return all;
  }
};
INSTANTIATE_TEST_SUITE_P(Ground, Placed, ::testing::Bool(), [](const auto& given) {
  return given.param ? "ThatMoves" : "ThatIsRigid";
});

MachineState at(const Vec3& position, std::optional<double> time_s = {}, double pitch = 0) {
  return {.machine = 0,
          .time_s = time_s,
          .pose = {position, Eigen::Quaterniond(Eigen::AngleAxisd(pitch, Vec3::UnitY()))}};
}

/// Mass of ground, buckets and what is on its way, less what came from elsewhere.
std::int64_t mass(const Session& session) {
  const MassBalance all = session.mass_balance();
  return all.ground + session.total().load + all.pending + all.hauled - all.poured;
}

void drag(Session& session, double from, double to, double z) {
  for (double x = from; x <= to; x += 0.1) ASSERT_TRUE(session.update(at({x, 0, z})).ok());
}

TEST_P(Placed, BucketsDigNothingAndGoOnFromThere) {
  Session session(site());
  drag(session, 0, 2, 0);
  const Ledger before = session.ledger(0);
  const StepResult placed = session.place(at({300, 5, 18}));
  ASSERT_TRUE(placed.ok()) << placed.why;
  EXPECT_EQ(placed.update.cut_m3, 0);
  EXPECT_EQ(session.ledger(0).cut(), before.cut());
  EXPECT_EQ(session.last(0)->pose.position, Vec3(300, 5, 18));
  // From there on it digs where it goes, and nowhere between.
  ASSERT_TRUE(session.update(at({300, 5, 15.0})).ok());
  ASSERT_TRUE(session.update(at({302, 5, 15.0})).ok());
  EXPECT_GT(session.ledger(0).cut_m3(), before.cut_m3() + 0.3);
  double heights[3];
  session.heights(std::vector<Vec2>{{150, 2.5}, {299, 5}, {1, 5}}, heights).check();
  EXPECT_DOUBLE_EQ(heights[0], 0.2 + 0.05 * 150);
  EXPECT_DOUBLE_EQ(heights[1], 0.2 + 0.05 * 299);
  EXPECT_DOUBLE_EQ(heights[2], 0.2 + 0.05 * 1);
  if (!GetParam()) {
    EXPECT_EQ(session.ledger(0).load, session.ledger(0).captured * before.units.bank);
  }
}

TEST_P(Placed, SoilIsNeitherMadeNorLost) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> way(0.5, 2.5), deep(-0.5, 0.1), pitch(-1.2, 1.2);
  Session session(site());
  double time_s = 0;
  for (int n = 0; n < 6; ++n) {
    for (double x = 0; x <= way(random); x += 0.1)
      ASSERT_TRUE(session.update(at({n + x, 0.5 * n, deep(random)}, time_s += 0.2)).ok());
    const StepResult placed =
        session.place(at({4 + way(random), -3, 2}, time_s += 0.1, pitch(random)));
    ASSERT_TRUE(placed.ok()) << placed.why;
    if (!GetParam()) continue;
    EXPECT_EQ(mass(session), 0) << n;
    const MassBalance all = session.mass_balance();
    EXPECT_LT(all.pending - all.lost_off_terrain, 2 * all.units.bank)
        << "what it pushed or spilled has come down, but for a sample";
    EXPECT_TRUE(session.place(at({n + 1.0, 0, 5}, time_s)).ok());
  }
  if (GetParam()) {
    EXPECT_GT(session.ledger(0).spilled, 0) << "at attitudes that hold less";
  }
}

TEST(PlacedBucket, WhatLeantOnItSlides) {
  Earthmoving loose = moving();
  loose.pours = {{"heap", {0.3, 0, 3}, 0, 0, 1.5}};
  loose.hoppers.clear();
  Session session(site_of(loose));
  ASSERT_TRUE(session.update(at({0, 0, -0.1})).ok());
  ASSERT_TRUE(session.pour(1).ok());
  const std::string held = session.save();
  ASSERT_TRUE(session.place(at({0, 8, 3})).ok());
  const std::string left = session.save();
  ASSERT_TRUE(session.come_to_rest().ok());
  const double change = session.change_m3();
  session.restore(left);
  EXPECT_NE(left, held);
  EXPECT_DOUBLE_EQ(session.change_m3(), change) << "it was at rest already";
  EXPECT_EQ(mass(session), 0);
}

TEST_P(Placed, RefusedPlacesChangeNothing) {
  Session session(site());
  drag(session, 0, 1, 0);
  ASSERT_TRUE(session.update(at({1, 0, 0.1}, 10)).ok());
  const std::string before = session.save();
  const auto why = [&](const MachineState& state) {
    const StepResult step = session.place(state);
    EXPECT_EQ(step.status, Status::kBadState);
    EXPECT_EQ(session.save(), before);
    return step.why;
  };
  EXPECT_THAT(why(at({5, 0, 0.4})),
              HasSubstr("machine 'digger': the bucket can only be placed in "));
  EXPECT_THAT(why(at({5, 0, -1})), HasSubstr("in the air above ground"));
  EXPECT_THAT(why(at({5, 0, 3}, 9)), HasSubstr("time goes back from 10 s to 9 s"));
  EXPECT_THAT(why(at({5, kNaN, 3})), HasSubstr("must be finite"));
  EXPECT_THAT(why({.machine = 4}), HasSubstr("there is no machine 4"));
}

TEST(PlacedBucket, APourThatComesDownMeanwhileRefusesNothing) {
  Earthmoving pours = moving();
  pours.pours = {{"truck", {5, 0, 6}, 1, 5, 10}};
  pours.hoppers.clear();
  Session session(site_of(pours));
  ASSERT_TRUE(session.update(at({0, 0, 2}, 0)).ok());
  const StepResult placed = session.place(at({5, 0, 1.2}, 6));
  ASSERT_TRUE(placed.ok()) << placed.why;
  ASSERT_TRUE(session.update(at({5, 0, 3}, 8)).ok());
  EXPECT_EQ(mass(session), 0);
}

TEST(PlacedBucket, ARefusedFirstPlaceIsNotTheSites) {
  Session session(site_of());
  const std::string before = session.save();
  for (const Vec3& place : {Vec3(1e6, 2e6, 5e4 - 5), Vec3(1e6, kNaN, 0)}) {
    EXPECT_FALSE(session.place(at(place)).ok());
    EXPECT_EQ(session.save(), before);
  }
  EXPECT_TRUE(session.place(at({1e6, 2e6, 5e4 + 5})).ok());
  EXPECT_TRUE(session.update(at({1e6, 2e6, 5e4})).ok());
  EXPECT_LT(session.change_m3(), 0);
}

TEST_P(Placed, StatesAndRecordingsHaveIt) {
  const TempFolder folder;
  std::string end;
  const auto feed_all = [&](Session& session) {
    drag(session, 0, 1, 0);
    ASSERT_TRUE(session.place(at({3, -2, 1.5}, 4, 0.4)).ok());
    ASSERT_TRUE(session.update(at({3, -2, 0}, 6)).ok());
    ASSERT_TRUE(session.update(at({4, -2, -0.2}, 8)).ok());
    ASSERT_TRUE(session.place(at({-3, -2, 1.5})).ok());
    ASSERT_TRUE(session.update(at({-2, -2, -0.1}, 9)).ok());
  };
  Session plain(site()), recorded(site());
  feed_all(plain);
  end = plain.save();
  recorded.record({.folder = folder / "a", .sync_s = 0});
  feed_all(recorded);
  EXPECT_EQ(recorded.save(), end);
  recorded.stop_recording();
  Session again(site());
  again.record({.folder = folder / "a", .sync_s = 0});
  EXPECT_EQ(again.save(), end);
  Session copy = plain.clone();
  for (Session* session : {&plain, &again, &copy}) {
    ASSERT_TRUE(session->place(at({0, 0, 4}, 20)).ok());
    ASSERT_TRUE(session->update(at({1, 0, -0.1}, 21)).ok());
  }
  EXPECT_EQ(again.save(), plain.save());
  EXPECT_EQ(copy.save(), plain.save());
}

}  // namespace session_place_test
}  // namespace soilvdb::test
