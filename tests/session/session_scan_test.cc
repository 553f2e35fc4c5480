// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scans of a session: recorded and gone on with, cloned, and in the mass balance.
#include <fmt/format.h>

#include <filesystem>
#include <random>

#include "tests/session/session_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace session_scan_test {

const Sensor kAbove{.name = "above", .pose = {{-1, 0, 6}, {0, 1, 0, 0}}, .range_sigma_m = 0.01};

/// Rays of a grid to the ground of a session that stands `deeper` than it is.
std::vector<Vec3> seen(Session& session, double deeper, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise(0, 0.01);
  std::vector<Vec3> ways;
  for (int i = 0; i < 90; ++i)
    for (int j = 0; j < 60; ++j) ways.emplace_back(0.012 * (i - 45), 0.012 * (j - 30), -1);
  std::vector<double> ranges(ways.size());
  session.cast(std::span(&kAbove.pose.position, 1), ways, ranges);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < ways.size(); ++i)
    if (std::isfinite(ranges[i]))
      points.push_back(kAbove.pose.position + (ranges[i] + noise(random)) * ways[i].normalized() -
                       Vec3(0, 0, deeper));
  return points;
}

/// Works and looks in turn.
void work(Session& session, const std::vector<MachineState>& all, std::uint64_t seed) {
  for (std::size_t i = 0; i < all.size(); ++i) {
    const StepResult step = session.update(all[i]);
    ASSERT_TRUE(step.ok()) << step.why;
    if (i % 12 != 5) continue;
    const std::vector<Vec3> points = seen(session, i % 24 == 5 ? 0.04 : -0.3, seed + i);
    const StepResult scanned = session.scan(kAbove, points);
    ASSERT_TRUE(scanned.ok()) << scanned.why;
    Survey survey;
    const StepResult applied = session.apply_scans(survey);
    ASSERT_TRUE(applied.ok()) << applied.why;
  }
}

/// Change of the ground's mass that nothing accounts for, units.
std::int64_t residual(const Session& session) {
  const MassBalance balance = session.mass_balance();
  return balance.ground + session.total().load + balance.pending + balance.hauled - balance.poured -
         balance.surveyed;
}

class SessionScans : public ::testing::TestWithParam<bool> {
 protected:
  SessionSite site() const { return site_of(GetParam() ? moving() : Earthmoving{}); }
};

TEST_P(SessionScans, GoOnFromWhereTheyWereRecorded) {
  for (const bool snapshots : {false, true}) {
    SCOPED_TRACE(snapshots);
    const TempFolder temp;
    Recording recording{.folder = temp / "site"};
    if (snapshots) recording.snapshot_every_s = 3;
    Session never_stopped(site());
    {
      Session session(site());
      session.record(recording);
      work(session, part(states(), 0, 0.6), 1);
      session.flush();
    }
    work(never_stopped, part(states(), 0, 0.6), 1);
    Session session(site());
    session.record(recording);
    ASSERT_EQ(session.ground_hash(), never_stopped.ground_hash());
    ASSERT_EQ(session.save(), never_stopped.save());
    work(session, part(states(), 0.6, 1), 2);
    work(never_stopped, part(states(), 0.6, 1), 2);
    EXPECT_EQ(session.save(), never_stopped.save());
  }
}

TEST_P(SessionScans, AreBookedAndLeaveLoads) {
  Session session(site());
  work(session, part(states(), 0, 0.5), 1);
  const Ledger before = session.ledger(0);
  const double change_m3 = session.change_m3();
  for (std::uint64_t n = 0; n < 5; ++n)  // six rays a column must agree
    ASSERT_TRUE(session.scan(kAbove, seen(session, -0.5, 9 + n)).ok());
  Survey survey;
  ASSERT_TRUE(session.apply_scans(survey).ok());
  EXPECT_GT(survey.added_m3, 1);
  EXPECT_EQ(session.ledger(0).load, before.load);
  EXPECT_EQ(session.ledger(0).cut(), before.cut());
  EXPECT_NEAR(session.change_m3() - change_m3, survey.added_m3 - survey.removed_m3, 1e-9);
  if (GetParam()) {
    EXPECT_EQ(residual(session), 0);
  }
  work(session, part(states(), 0.5, 1), 3);
  ASSERT_TRUE(session.come_to_rest().ok());
  if (GetParam()) {
    EXPECT_EQ(residual(session), 0);
  }
}

TEST_P(SessionScans, OfClonesAndRestoredStatesGoOnAlike) {
  Session session(site());
  work(session, part(states(), 0, 0.4), 1);
  ASSERT_TRUE(session.scan(kAbove, seen(session, 0.04, 5)).ok());  // and not applied
  Session clone = session.clone(), restored(site());
  restored.restore(session.save());
  for (Session* each : {&session, &clone, &restored}) {
    Survey survey;
    ASSERT_TRUE(each->apply_scans(survey).ok());
    work(*each, part(states(), 0.4, 0.8), 2);
  }
  EXPECT_EQ(clone.save(), session.save());
  EXPECT_EQ(restored.save(), session.save());
}

TEST_P(SessionScans, NeverReadBytesOfAnotherState) {
  Session session(site());
  work(session, part(states(), 0, 0.3), 1);
  const std::string good = session.save();
  std::mt19937_64 random(3);
  for (int i = 0; i < 60; ++i) {
    std::string bad = good;
    if (i % 2 == 0)
      bad.resize(random() % bad.size());
    else
      for (int k = 0; k < 4; ++k)
        bad[random() % bad.size()] ^= static_cast<char>(1 << random() % 8);
    Session other(site());
    try {
      other.restore(bad);
    } catch (const std::invalid_argument&) {
      EXPECT_EQ(other.save(), Session(site()).save());
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Soil, SessionScans, ::testing::Bool(),
                         [](const auto& of) { return of.param ? "Moves" : "IsRigid"; });

}  // namespace session_scan_test
}  // namespace soilvdb::test
