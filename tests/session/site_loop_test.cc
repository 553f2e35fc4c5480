// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site without files does what a session does, to the last bit.
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "soilvdb/site.h"
#include "tests/session/session_fixture.h"

namespace soilvdb::site_loop_test {
namespace {

using namespace test;

/// As the session's.
Site site_like(const Session& session) {
  return Site(std::make_shared<Ground>(session.voxel_size_m(), session.origin(),
                                       make_plane(0.2, {0.05, 0})),
              {session.machines(), session.earthmoving()});
}

class Sites : public Sessions {};

void expect_same(const Site& site, const Session& session) {
  EXPECT_EQ(site.ground().state_hash(), session.ground_hash());
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(site.tracker().ledger(i).load, session.ledger(i).load);
    EXPECT_EQ(site.tracker().ledger(i).cut(), session.ledger(i).cut());
  }
  EXPECT_EQ(site.last_s(), session.last(1)->time_s);
}

TEST_P(Sites, DoWhatSessionsDo) {
  Session session(site());
  Site alone = site_like(session);
  for (const MachineState& state : states()) {
    const StepResult a = session.update(state), b = alone.update(state);
    ASSERT_TRUE(b.ok()) << b.why;
    EXPECT_EQ(a.update.cut_m3, b.update.cut_m3);
    EXPECT_EQ(a.update.bucket_m3, b.update.bucket_m3);
  }
  expect_same(alone, session);
  ASSERT_TRUE(session.pour(35).ok());
  ASSERT_TRUE(alone.pour(35).ok());
  ASSERT_TRUE(session.reset_clock(0).ok());
  ASSERT_TRUE(alone.reset_clock(0).ok());
  EXPECT_FALSE(alone.last(0)->time_s);
  MachineState again = states().front();
  *again.time_s = 1;
  ASSERT_TRUE(session.update(again).ok());
  ASSERT_TRUE(alone.update(again).ok());
  ASSERT_TRUE(session.come_to_rest().ok());
  ASSERT_TRUE(alone.come_to_rest().ok());
  expect_same(alone, session);
}

TEST_P(Sites, TakeBatchesWhollyOrNotAtAll) {
  Session session(site());
  Site alone = site_like(session), one_by_one = site_like(session);
  std::vector<MachineState> all = part(states(), 0, 0.5);
  const BatchResult made = alone.update(all);
  ASSERT_TRUE(made.ok()) << made.why;
  ASSERT_EQ(made.updates.size(), all.size());
  for (std::size_t i = 0; i < all.size(); ++i)
    EXPECT_EQ(one_by_one.update(all[i]).update.cut_m3, made.updates[i].cut_m3);
  EXPECT_EQ(alone.ground().state_hash(), one_by_one.ground().state_hash());
  const std::string before = alone.progress();
  std::vector<MachineState> bad = part(states(), 0.5, 0.75);
  bad[3].time_s = -1;
  const BatchResult refused = alone.update(bad);
  EXPECT_EQ(refused.status, Status::kBadState);
  EXPECT_EQ(refused.bad, 3u);
  EXPECT_NE(refused.why.find("time goes back"), std::string::npos) << refused.why;
  EXPECT_EQ(alone.progress(), before);
  EXPECT_EQ(alone.ground().state_hash(), one_by_one.ground().state_hash());
}

TEST(SiteLoop, PoursPartBatchesOnlyWhereSomeOfThemFalls) {
  const SiteModel model = {{{"a", digger()}, {"b", digger()}},
                           loam_with_pours({{"tip", {0, 0, 3}, 10, 12, 1}})};
  std::vector<MachineState> all;
  const std::vector<Pose> here = cycle({-20, 0, 0}, 0.5, 80), there = cycle({20, 0, 0}, 0.5, 80);
  for (std::size_t i = 0; i < here.size(); ++i) {
    all.push_back({0, 0.25 * static_cast<double>(i), here[i]});
    all.push_back({1, 0.25 * static_cast<double>(i), there[i]});
  }
  const auto ground = [] {
    return std::make_shared<Ground>(0.1, Vec3(0, 0, 0), make_plane(0, {0, 0}));
  };
  Site batch(ground(), model), one_by_one(ground(), model);
  ASSERT_TRUE(batch.update(all).ok());
  for (const MachineState& state : all) ASSERT_TRUE(one_by_one.update(state).ok());
  EXPECT_GT(batch.tracker().mass_balance().poured, 0);
  EXPECT_EQ(batch.ground().state_hash(), one_by_one.ground().state_hash());
  EXPECT_EQ(batch.progress(), one_by_one.progress());
  const Tracker::BatchCounts counts = batch.tracker().batch_counts();
  EXPECT_GT(counts.apart + counts.set_back, 1u) << "machines move at once before and after";
  EXPECT_LT(counts.apart + counts.set_back, all.size() / 4);
}

TEST_P(Sites, GoOnInACopyAndFromProgress) {
  Session session(site());
  Site first = site_like(session);
  for (const MachineState& state : part(states(), 0, 0.5)) ASSERT_TRUE(first.update(state).ok());
  Site copy(first);
  EXPECT_EQ(&copy.model(), &first.model()) << "it is shared";
  Site restored(first.ground().clone(), first.model());
  restored.set_progress(first.progress());
  for (const MachineState& state : part(states(), 0.5, 1)) {
    ASSERT_TRUE(first.update(state).ok());
    ASSERT_TRUE(copy.update(state).ok());
    ASSERT_TRUE(restored.update(state).ok());
  }
  EXPECT_EQ(copy.ground().state_hash(), first.ground().state_hash());
  EXPECT_EQ(restored.ground().state_hash(), first.ground().state_hash());
  EXPECT_EQ(copy.progress(), first.progress());
  EXPECT_EQ(restored.progress(), first.progress());
}

TEST_P(Sites, RefuseWhatCantBeAndStayAsTheyWere) {
  Session session(site());
  Site alone = site_like(session);
  ASSERT_TRUE(alone.update(states().front()).ok());
  const std::string before = alone.progress();
  const auto why = [&](const MachineState& state) {
    const StepResult step = alone.update(state);
    EXPECT_FALSE(step.ok());
    return step.why;
  };
  EXPECT_EQ(why({.machine = 2}), "there is no machine 2; there are 2, numbered from 0");
  EXPECT_EQ(why({.machine = 0, .time_s = kNaN}), "machine 'digger': the time must be finite");
  const std::vector<double> joints = {1.0};
  EXPECT_EQ(why({.machine = 0, .joints = joints}),
            "machine 'digger' has no joints; give it a pose");
  EXPECT_FALSE(alone.pour(kNaN).ok());
  EXPECT_FALSE(alone.reset_clock(7).ok());
  EXPECT_EQ(alone.progress(), before);
  EXPECT_THROW(alone.set_progress("no progress"), std::invalid_argument);
  EXPECT_EQ(alone.progress(), before);
  EXPECT_THROW(Site(std::make_shared<Ground>(0.1, Vec3::Zero(), make_plane(0, {0, 0})),
                    {{{"a", digger()}, {"a", digger()}}}),
               std::invalid_argument);
  EXPECT_EQ(session.machine("plate"), 1u);
  EXPECT_THROW(session.machine("crane"), std::invalid_argument);
}

INSTANTIATE_TEST_SUITE_P(RigidOrMoving, Sites, ::testing::Bool());

}  // namespace
}  // namespace soilvdb::site_loop_test
