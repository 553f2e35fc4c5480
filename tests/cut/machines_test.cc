// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Machines between two poses and beside each other: against closed forms and against one after
// another.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "soilvdb/tracker.h"

namespace soilvdb::test {
namespace machines_test {

TEST(Motion, SimplifiedKeepsARowThatAloneIsOff) {
  const Bucket bucket{0.6, 0.4, {}, {}};
  constexpr int kRows = 12;
  for (int off = 0; off < kRows; ++off) {
    std::vector<double> times_s;
    std::vector<Pose> poses;
    for (int i = 0; i < kRows; ++i) {
      times_s.push_back(i);
      poses.push_back(Pose{{0.1 * i, i == off ? 0.05 : 0, 0}});
    }
    const Motion thin = Motion(times_s, poses).simplified(bucket, 1e-3);
    for (int i = 0; i < kRows; ++i) {
      EXPECT_NEAR((thin.pose(i).position - poses[static_cast<std::size_t>(i)].position).norm(), 0,
                  1e-3)
          << "row " << i << ", with " << off << " off";
    }
    EXPECT_LE(thin.times_s().size(), 5u);
  }
}

TEST(Machines, ALoadLeavesWhereTheMouthLooksDownBetweenTwoPoses) {
  Bucket bucket{0.6, 0.4, {}, 0.8};
  Ground ground(0.05, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {bucket});
  tracker.update(0, Pose{{0, 0, -0.2}});
  EXPECT_GT(tracker.update(0, Pose{{1, 0, -0.2}}).bucket_m3, 0);
  EXPECT_GT(tracker.update(0, Pose{{1, 0, 5}, from_rpy(0, 0.6, 0)}).bucket_m3, 0);
  // Over to the other side: half-way it looks straight down.
  EXPECT_EQ(tracker.update(0, Pose{{1, 0, 5}, from_rpy(0, std::numbers::pi - 0.6, 0)}).bucket_m3,
            0);
}

TEST(Machines, ATurnInTheAirThatDipsIntoTheGroundCutsIt) {
  constexpr double kPi = std::numbers::pi, kHeight = 0.4, kAbove = 0.3, kWidth = 0.6;
  Ground ground(0.025, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {Bucket{kWidth, kHeight, {}, {}}});
  // The upper edge hangs down on one side, then on the other: it is lowest in between.
  const auto to = [&](double pitch) { return Pose{{0, 0, kAbove}, from_rpy(0, pitch, 0)}; };
  tracker.update(0, to(kPi - 0.9));
  const double segment = kHeight * kHeight * std::acos(kAbove / kHeight) -
                         kAbove * std::sqrt(kHeight * kHeight - kAbove * kAbove);
  EXPECT_NEAR(tracker.update(0, to(kPi + 0.9)).cut_m3, segment * kWidth, 0.02 * segment * kWidth);
}

Move move_to(std::size_t machine, double x, double y) {
  Move move;
  move.machine = machine;
  move.to = Pose{{x, y, -0.2}};
  return move;
}
void expect_in_order(const std::vector<std::pair<double, double>>& from,
                     const std::vector<Move>& moves) {
  const tbb::global_control control(tbb::global_control::max_allowed_parallelism, 1);
  const std::vector<Bucket> buckets(from.size(), Bucket{0.6, 0.4, {}, {}});
  std::vector<double> cuts[2];
  for (const bool at_once : {false, true}) {
    Ground ground(0.05, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(ground, buckets);
    for (std::size_t m = 0; m < from.size(); ++m)
      tracker.update(m, move_to(m, from[m].first, from[m].second).to);
    if (at_once) {
      for (const Update& update : tracker.update(moves)) cuts[1].push_back(update.cut_m3);
    } else {
      for (const Move& move : moves)
        cuts[0].push_back(tracker.update(move.machine, move.to).cut_m3);
    }
  }
  EXPECT_EQ(cuts[0], cuts[1]);
}
TEST(Machines, MachinesWhoseWaysCrossMoveInOrder) {
  // Each goes to where the other was, along one line.
  expect_in_order({{0, 0}, {20, 0}}, {move_to(1, 0, 0), move_to(0, 20, 0)});
  expect_in_order({{0, 0}, {20, 10}}, {move_to(1, 20, -10), move_to(0, 40, 0)});
}
TEST(Machines, MachinesThatMeetByAThirdMoveInOrder) {
  expect_in_order({{0, 0}, {40, 0}, {2, 0}},
                  {move_to(2, 42, 0), move_to(0, 3, 0), move_to(1, 41, 0)});
  expect_in_order({{0, 0}, {40, 0}, {42, 0}},
                  {move_to(2, -2, 0), move_to(1, 41, 0), move_to(0, 3, 0)});
}

}  // namespace machines_test
}  // namespace soilvdb::test
