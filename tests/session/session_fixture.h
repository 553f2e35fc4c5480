// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site of two machines, rigid or with soil that moves, and the states they are fed.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "soilvdb/session.h"
#include "tests/support/earthmoving_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {

inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

inline SessionSite site_of(Earthmoving earthmoving = {}) {
  return {.voxel_size_m = 0.1,
          .terrain = io::PlaneTerrain{0.2, {0.05, 0}},
          .machines = {{"digger", digger()}, {"plate", Bucket{1.0, 0.6, {}, 0.8}}},
          .earthmoving = std::move(earthmoving)};
}

inline Earthmoving moving() {
  Earthmoving all = loam_with_pours({{"truck", {2, 2, 4}, 5, 40, 2}});
  all.pours.push_back({"beside it", {2.6, 2, 4}, 6, 30, 1});
  all.hoppers.push_back({"bin", {Vec2(-1, 2.5), Vec2(3, 5.5)}, 0.5, 0, 30});  // gone as it tips
  return all;
}

/// Two machines' states in turn.
inline std::vector<MachineState> states() {
  std::vector<MachineState> all;
  double time_s = 0;
  for (const Pose& pose : cycle({-3, 0, 0}, 0.5, 40)) {
    MachineState digs{.machine = 0, .time_s = time_s += 0.5, .pose = pose};
    MachineState pushes{.machine = 1, .time_s = time_s, .pose = {pose.position, {1, 0, 0, 0}}};
    pushes.pose.position += Vec3(0.7, -1.5, 0.1);
    all.push_back(digs);
    all.push_back(pushes);
  }
  return all;
}

inline std::vector<MachineState> part(const std::vector<MachineState>& all, double from,
                                      double to) {
  const auto at = [&](double share) {
    return all.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(all.size()));
  };
  return {at(from), at(to)};
}

inline void feed(Session& session, const std::vector<MachineState>& all) {
  for (const MachineState& state : all) {
    const StepResult step = session.update(state);
    ASSERT_TRUE(step.ok()) << step.why;
  }
}

/// Works in rounds, with snapshots or without, in a session that never stops and in one that is
/// recorded and opened anew after each round.
inline void expect_same_if_stopped(const SessionSite& site, int rounds,
                                   const std::function<void(Session&, int)>& work) {
  for (const bool snapshots : {false, true}) {
    SCOPED_TRACE(snapshots);
    const TempFolder temp;
    Recording recording{.folder = temp / "site"};
    if (snapshots) recording.snapshot_every_s = 2;
    Session never_stopped(site);
    std::optional<Session> session(site);
    session->record(recording);
    for (int round = 0; round < rounds; ++round) {
      for (Session* each : {&never_stopped, &*session}) work(*each, round);
      ASSERT_TRUE(session->save() == never_stopped.save()) << round;
      session->flush();
      session.reset();
      session.emplace(site);
      session->record(recording);
      ASSERT_TRUE(session->save() == never_stopped.save()) << round;
    }
  }
}

/// Takes back all states of the first machine after a time.
inline void take_back(Session& session, const Session& start, const Recording& recording,
                      double after_s) {
  session.flush();
  const StatesAfter after = start.states_after(recording.folder, 0, after_s);
  EXPECT_GT(after.states, 0u);
  session.undo(*start.without(recording.folder, after, recording.snapshot_every_s,
                              [](const io::JournalUpdate&) {}));
}

/// Change of the ground's mass that nothing accounts for, units.
inline std::int64_t residual(const Session& session) {
  const MassBalance balance = session.mass_balance();
  return balance.ground + session.total().load + balance.pending + balance.hauled - balance.poured -
         balance.surveyed;
}

class Sessions : public ::testing::TestWithParam<bool> {
 protected:
  static SessionSite site() { return site_of(GetParam() ? moving() : Earthmoving{}); }
};

}  // namespace soilvdb::test
