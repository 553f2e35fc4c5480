// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Surveys as new ground of a session: recorded and gone on with, taken back around, at other times.
#include <gmock/gmock.h>

#include <cmath>

#include "soilvdb/survey_heights.h"
#include "tests/session/session_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace session_survey_test {

/// Over the dig and its surroundings: waves, with a void in it.
SurveyHeights morning(double level_m = 0.1) {
  SurveyHeights heights{{-50, -35}, {100, 83}, {}};
  for (int x = 0; x < heights.size.x(); ++x)
    for (int y = 0; y < heights.size.y(); ++y)
      heights.heights.push_back(
          std::hypot(x - 30, y - 20) < 6
              ? SurveyHeights::kNone
              : static_cast<std::int32_t>(std::lround(
                    640 * (level_m + 0.25 * std::sin(0.1 * x) + 0.1 * std::cos(0.17 * y)))));
  return heights;
}

SurveyVolumes take(Session& session, const SurveyHeights& heights) {
  SurveyVolumes volumes;
  const StepResult made = session.survey(heights, volumes);
  EXPECT_TRUE(made.ok()) << made.why;
  return volumes;
}

using SessionSurveys = Sessions;

TEST_P(SessionSurveys, GoOnFromWhereTheyWereRecorded) {
  expect_same_if_stopped(site(), 4, [](Session& session, int round) {
    feed(session, part(states(), 0.2 * round, 0.2 * round + 0.2));
    const SurveyVolumes volumes = take(session, morning(0.1 - 0.05 * round));
    EXPECT_GT(volumes.changed, 1000);
    EXPECT_GT(volumes.removed_m3 + volumes.added_m3, 1);
    if (GetParam()) {
      EXPECT_EQ(residual(session), 0);
    }
    ASSERT_TRUE(session.surveyed());
    EXPECT_GT(session.surveyed()->removed, 0);
  });
}

TEST_P(SessionSurveys, AreOfTheirTime) {
  const TempFolder temp;
  Session session(site());
  session.record({.folder = temp / "site"});
  feed(session, part(states(), 0, 0.4));
  const std::uint64_t before = session.ground_hash();
  const double time_s = *part(states(), 0, 0.4).back().time_s;
  const double earlier_s = time_s - 2;
  std::vector<MachineState> before_that;
  for (const MachineState& state : states())
    if (*state.time_s <= earlier_s) before_that.push_back(state);
  Session earlier(site());
  feed(earlier, before_that);
  take(session, morning());
  const std::uint64_t after = session.ground_hash();
  EXPECT_NE(after, before);
  feed(session, part(states(), 0.4, 0.6));
  session.flush();
  const Session any(site());
  EXPECT_EQ(any.recorded(temp / "site", time_s).ground_hash(), after);
  EXPECT_EQ(any.recorded(temp / "site", earlier_s).ground_hash(), earlier.ground_hash());
}

TEST_P(SessionSurveys, AreCloned) {
  Session session(site());
  feed(session, part(states(), 0, 0.4));
  Session clone = session.clone();
  take(session, morning());
  feed(session, part(states(), 0.4, 0.6));
  take(clone, morning());
  feed(clone, part(states(), 0.4, 0.6));
  EXPECT_TRUE(clone.save() == session.save());
}

// A survey is of all ground, whoever dug it: it is taken again on what is then there.
TEST_P(SessionSurveys, StayWhenStatesBeforeThemAreTakenBack) {
  const TempFolder temp;
  const Recording recording{.folder = temp / "site", .snapshot_every_s = 4};
  std::vector<MachineState> others;
  for (const MachineState& state : part(states(), 0.3, 0.6))
    if (state.machine == 1) others.push_back(state);
  Session never(site());
  feed(never, part(states(), 0, 0.3));
  feed(never, others);
  take(never, morning());
  std::optional<Session> session(site());
  session->record(recording);
  feed(*session, part(states(), 0, 0.6));
  take(*session, morning());
  take_back(*session, Session(site()), recording, *part(states(), 0, 0.3).back().time_s);
  EXPECT_EQ(session->ground_hash(), never.ground_hash());
  ASSERT_TRUE(session->save() == never.save());
  for (Session* each : {&never, &*session}) feed(*each, part(states(), 0.6, 0.8));
  ASSERT_TRUE(session->save() == never.save());
  session.reset();
  session.emplace(site());
  session->record(recording);
  EXPECT_TRUE(session->save() == never.save());
}

// As those of deep changes are taken: each with the columns about it, which tell slopes.
TEST_P(SessionSurveys, InPiecesGiveTheSameGroundAsTheWhole) {
  const TempFolder temp;
  Session whole(site());
  std::optional<Session> pieces(site());
  pieces->record({.folder = temp / "site"});
  SurveyHeights heights = morning();
  for (int x = 20; x < 60; ++x)  // a deep pit with steep sides, cut by the pieces' edges
    for (int y = 10; y < 60; ++y)
      if (std::int32_t& z = heights.heights[heights.number(x, y)]; z != SurveyHeights::kNone)
        z -= 64 * (40 + x % 7);
  for (Session* each : {&whole, &*pieces}) feed(*each, part(states(), 0, 0.4));
  const SurveyVolumes made = take(whole, heights);
  SurveyVolumes sum;
  for (int x = 0; x < 100; x += 34) {
    for (int y = 0; y < 83; y += 29) {
      SurveyHeights piece{heights.first + Coord2(x - 1, y - 1),
                          Coord2(std::min(34, 100 - x), std::min(29, 83 - y)) + Coord2(2, 2),
                          {},
                          1};
      for (int i = 0; i < piece.size.x(); ++i)
        for (int j = 0; j < piece.size.y(); ++j) {
          const int u = x - 1 + i, v = y - 1 + j;
          const bool is_in = u >= 0 && v >= 0 && u < 100 && v < 83;
          piece.heights.push_back(is_in ? heights.heights[heights.number(u, v)]
                                        : SurveyHeights::kNone);
        }
      const SurveyVolumes volumes = take(*pieces, piece);
      sum.removed_m3 += volumes.removed_m3;
      sum.added_m3 += volumes.added_m3;
      sum.changed += volumes.changed;
    }
  }
  EXPECT_EQ(pieces->ground_hash(), whole.ground_hash());
  EXPECT_EQ(sum.changed, made.changed);
  EXPECT_NEAR(sum.removed_m3, made.removed_m3, 1e-9);
  EXPECT_NEAR(sum.added_m3, made.added_m3, 1e-9);
  for (Session* each : {&whole, &*pieces}) feed(*each, part(states(), 0.4, 0.6));
  ASSERT_TRUE(pieces->save() == whole.save());
  pieces.reset();
  pieces.emplace(site());
  pieces->record({.folder = temp / "site"});
  EXPECT_TRUE(pieces->save() == whole.save());
}

TEST_P(SessionSurveys, GiveTheSameGroundWithLittleMemory) {
  const TempFolder temp;
  Session free(site()), limited(site());
  limited.set_memory_limit(3 << 20, temp.path());
  for (Session* each : {&free, &limited}) {
    feed(*each, part(states(), 0, 0.4));
    take(*each, morning());
    feed(*each, part(states(), 0.4, 0.6));
    take(*each, morning(-0.4));
  }
  EXPECT_EQ(limited.ground_hash(), free.ground_hash());
}

TEST(SessionSurveysOnEndlessPlanes, AreWhereTheyAre) {
  const Vec3 far(500'000, 4'000'000, 0);
  SessionSite site = site_of();
  site.terrain = io::PlaneTerrain{0, {0, 0}};
  Session session(std::move(site));
  session.begin_near(far);
  EXPECT_LT((session.origin() - far).norm(), 1e5);
  const Coord2 first =
      session.site().ground->index_from_world(far).head<2>().array().round().matrix().cast<int>();
  take(session, {first, {8, 8}, std::vector<std::int32_t>(64, 64)});
  session.begin_near(Vec3::Zero());  // it is there now
  EXPECT_LT((session.origin() - far).norm(), 1e5);
  double z = 0;
  const Vec2 at = far.head<2>() + Vec2(0.3, 0.3);
  session.heights({&at, 1}, {&z, 1}).check();
  EXPECT_NEAR(z, session.origin().z() + 0.1, 1e-9);
}

INSTANTIATE_TEST_SUITE_P(RigidOrMoving, SessionSurveys, ::testing::Bool());

}  // namespace session_survey_test
}  // namespace soilvdb::test
