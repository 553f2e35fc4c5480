// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The books: what is cut is what the ground lost, for any path, machine and number of threads.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <numbers>

#include "core/cut/excavator.h"
#include "tests/support/dig_runner.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace ledger_test {

constexpr double kPi = std::numbers::pi;
constexpr double kVoxel = 0.05;

/// A bucket of 0.6 m by 0.4 m with a body behind its mouth.
Bucket bucket_with_body() { return {0.6, 0.4, {{0, 0}, {-0.3, 0.08}, {-0.35, 0.3}, {0, 0.4}}, {}}; }

Pose at(double x, double y, double z, double pitch = 0, double yaw = 0) {
  return {{x, y, z}, from_rpy(0, pitch, yaw)};
}

/// The ground is short of what was cut to 1e-9 of it.
void expect_balanced(const Ground& ground, const Ledger& total) {
  EXPECT_GT(total.cut_m3(), 0);
  EXPECT_DOUBLE_EQ(total.cut_m3(), total.captured_m3() + total.displaced_m3());
  EXPECT_LE(std::abs(ground.change_m3() + total.cut_m3()), 1e-9 * total.cut_m3());
}

TEST(Ledger, BalancesForEveryDig) {
  for (const std::string& family : families()) {
    const Dug dug(make_dig(family, placements()[1]), kVoxel, 30);
    SCOPED_TRACE(family);
    expect_balanced(dug.ground, dug.tracker.total());
    EXPECT_EQ(dug.tracker.total().displaced, 0);  // there is no body
    EXPECT_EQ(dug.tracker.total().dumped, 0);
  }
}

TEST(Ledger, BalancesAfterManyUpdates) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0.05, -0.02}));
  Tracker tracker(ground, {bucket_with_body()});
  constexpr int kUpdates = test::kSanitized ? 5000 : 100000;
  double sum = 0;
  for (int i = 0; i <= kUpdates; ++i) {
    const double t = static_cast<double>(i) / kUpdates * 40 * kPi;  // twenty strokes, each aside
    const Update u = tracker.update(0, at(0.7 * std::cos(t), 0.015 * t, -0.15 - 0.25 * std::sin(t),
                                          0.3 * std::sin(t), 0.01 * t));
    sum += u.cut_m3;
    ASSERT_GE(u.cut_m3, 0);
  }
  expect_balanced(ground, tracker.total());
  EXPECT_LE(std::abs(sum - tracker.total().cut_m3()), 1e-9 * sum);
}

TEST(Ledger, TheTotalIsTheSumOverMachines) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  const Bucket open{0.6, 0.4, {}, {}};
  Tracker tracker(ground, {open, bucket_with_body(), open});
  // Side by side, crossing one another's cuts, in turn.
  for (int i = 0; i <= 40; ++i) {
    const double s = i / 40.0;
    tracker.update(0, at(s, 0, -0.2));
    tracker.update(1, at(0.5, 1 - 2 * s, -0.25, 0.1, -kPi / 2));
    tracker.update(2, at(s, 0.3, -0.1));
  }
  std::int64_t captured = 0, displaced = 0;
  for (std::size_t m = 0; m < 3; ++m) {
    const Ledger& one = tracker.ledger(m);
    EXPECT_GT(one.captured, 0) << "machine " << m;
    EXPECT_EQ(one.displaced > 0, m == 1) << "machine " << m;
    captured += one.captured;
    displaced += one.displaced;
  }
  EXPECT_EQ(tracker.total().captured, captured);
  EXPECT_EQ(tracker.total().displaced, displaced);
  expect_balanced(ground, tracker.total());
}

TEST(Ledger, ALoadLeavesWhereTheMouthLooksDown) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  Bucket bucket{0.6, 0.4, {}, 0.8};
  Tracker tracker(ground, {bucket});
  tracker.update(0, at(0, 0, -0.2));
  tracker.update(0, at(1, 0, -0.2));
  const double load = tracker.update(0, at(1, 0, 0.5)).bucket_m3;
  EXPECT_GT(load, 0);
  EXPECT_EQ(tracker.update(0, at(1, 0, 0.5, 0.79)).bucket_m3, load) << "not yet steep enough";
  EXPECT_EQ(tracker.update(0, at(1, 0, 0.5, 0.81)).bucket_m3, 0);
  EXPECT_EQ(tracker.ledger(0).dumped_m3(), load);
  tracker.update(0, at(0, 1, 0.5));
  tracker.update(0, at(0, 1, -0.2));
  EXPECT_GT(tracker.update(0, at(1, 1, -0.2)).bucket_m3, 0) << "it digs on";
  EXPECT_EQ(tracker.ledger(0).dumped_m3(), load);
  expect_balanced(ground, tracker.total());
}

TEST(Ledger, ALoadLeavesWithinAnUpdateToo) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {Bucket{0.6, 0.4, {}, 0.8}});
  tracker.update(0, at(0, 0, -0.2));
  // Down to 1.2 rad and back within one update.
  const Motion motion({0, 1, 2, 3, 4, 5}, {at(0, 0, -0.2), at(1, 0, -0.2), at(1, 0, 0.6),
                                           at(1, 0, 0.6, 1.2), at(1, 0, 0.6, 0), at(2, 0, 0.6)});
  EXPECT_EQ(tracker.update(0, motion, 0, 5).bucket_m3, 0);
  EXPECT_EQ(tracker.ledger(0).dumped, tracker.ledger(0).captured);
  EXPECT_GT(tracker.ledger(0).dumped, 0);
}

TEST(Ledger, AnyNumberOfThreadsGivesTheSameBits) {
  for (const char* family : {"drag_curl_retreat", "undercut", "helix", "raster"}) {
    if (test::kSanitized && std::string_view(family) == "helix") break;
    const Dig dig = make_dig(family, placements()[1]);
    std::uint64_t hash = 0;
    std::int64_t captured = 0;
    for (const std::size_t threads : {1u, 2u, 4u, 8u}) {
      const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
      const Dug dug(dig, 0.025, 15);
      if (threads == 1) {
        hash = dug.ground.state_hash();
        captured = dug.tracker.total().captured;
      }
      EXPECT_EQ(dug.ground.state_hash(), hash) << family << ", threads " << threads;
      EXPECT_EQ(dug.tracker.total().captured, captured) << family << ", threads " << threads;
    }
  }
}

TEST(Ledger, AnySplitOfAPathGivesTheSameSamples) {
  for (const bool body : {false, true}) {
    Dig dig = make_dig("drag_curl_retreat", placements()[2]);
    if (body) dig.bucket.profile = {{0, 0}, {-0.4, 0.1}, {-0.4, 0.4}, {0, 0.5}};
    const auto path = dig.motion.trace(0, 1, dig.bucket, 1e-5, 0.4);
    std::int64_t whole = 0, whole_captured = 0;
    for (const std::size_t length : {path.size(), std::size_t{3}, std::size_t{7}}) {
      Ground ground(kVoxel, dig.origin, dig.terrain);
      Excavator excavator(dig.bucket);
      Ledger total;
      total.sample_m3 = ground.sample_m3();
      for (std::size_t i = 0; i + 1 < path.size(); i += length - 1) {
        const Cut cut =
            excavator.sweep(ground, std::span(path).subspan(i, std::min(length, path.size() - i)));
        total.captured += cut.all.captured;
        total.displaced += cut.all.displaced;
      }
      if (length == path.size()) whole = total.captured + total.displaced;
      if (length == path.size()) whole_captured = total.captured;
      EXPECT_EQ(total.captured + total.displaced, whole) << "poses per update: " << length;
      EXPECT_EQ(total.captured, whole_captured) << "poses per update: " << length;
      expect_balanced(ground, total);
    }
  }
}

}  // namespace ledger_test
}  // namespace soilvdb::test
