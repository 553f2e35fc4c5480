// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Jobs beside updates: they see what they would have seen had updates waited for them.
#include "soilvdb/ground_copy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <latch>
#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "soilvdb/change_follower.h"
#include "soilvdb/mesher.h"
#include "tests/support/dig_runner.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace ground_copy_test {

constexpr double kVoxel = 0.05;

/// A dig that is followed by a copy.
struct Followed {
  Dig dig;
  Ground ground, copy;
  Tracker tracker;
  ChangeFollower changes;
  std::vector<std::uint64_t> expected, seen;  // hashes
  GroundCopy ground_copy;

  explicit Followed(Dig d, bool thread = true, std::size_t most_jobs = 4)
      : dig(std::move(d)),
        ground(kVoxel, dig.origin, dig.terrain),
        copy(kVoxel, dig.origin, dig.terrain),
        tracker(ground, {dig.bucket}),
        changes(ground),
        ground_copy(copy, thread, most_jobs) {}

  /// Digs a part of the motion, from 0 to 1, in one update.
  void update(double from, double to) {
    const double begin = dig.motion.begin_s(), span = dig.motion.end_s() - begin;
    tracker.update(0, dig.motion, begin + span * from, begin + span * to);
  }
  void post() { ground_copy.post(ground, changes.take()); }
  void look() {
    expected.push_back(ground.state_hash());
    ground_copy.run([this] { seen.push_back(copy.state_hash()); });
  }
};

class GroundCopyTest : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Threads, GroundCopyTest, ::testing::Bool(),
                         [](const auto& thread) { return thread.param ? "OneOfItsOwn" : "None"; });

TEST_P(GroundCopyTest, AJobSeesTheGroundAsItWasWhenItWasAskedFor) {
  constexpr int kUpdates = 60;
  const std::size_t one_of = test::kLong ? 1 : test::kSanitized ? 4 : 3;
  int n = 0;
  for (std::size_t k = 0; k < families().size(); k += one_of) {
    const std::string& family = families()[k];
    for (const int updates_per_post : {1, 7}) {
      SCOPED_TRACE(family + ", a post every " + std::to_string(updates_per_post));
      const std::size_t at = static_cast<std::size_t>(++n) % placements().size();
      Followed f(make_dig(family, placements()[at]), GetParam());
      for (int i = 0; i < kUpdates; ++i) {
        f.update(double(i) / kUpdates, double(i + 1) / kUpdates);
        if (i % updates_per_post != 0) continue;
        f.post();
        if (i % 2 == 0) f.look();  // some jobs after several posts
      }
      f.post();
      f.look();
      f.ground_copy.finish();
      EXPECT_TRUE(f.ground_copy.done());
      ASSERT_GT(f.tracker.total().captured, 0);
      EXPECT_EQ(f.seen, f.expected);
    }
  }
}

TEST_P(GroundCopyTest, BlocksThatAJobMeshesAreThoseOfTheGround) {
  constexpr int kUpdates = 40;
  Followed f(make_dig("drag_curl_retreat", placements()[1]), GetParam());
  CachedMesher mesher(f.copy);
  std::set<Coord3, Before> wanted;
  std::map<Coord3, Mesh, Before> patches;
  const auto mesh_wanted = [&] {
    f.ground_copy.run([&, blocks = std::exchange(wanted, {})] {
      for (const Coord3& block : blocks) patches[block] = mesher.block(block);
    });
  };
  for (int i = 0; i < kUpdates; ++i) {
    f.update(double(i) / kUpdates, double(i + 1) / kUpdates);
    const std::vector<Coord3> changed = f.changes.take();
    f.ground_copy.post(f.ground, changed);
    for (const Coord3& block : blocks_touched(changed)) wanted.insert(block);
    if (f.ground_copy.done()) mesh_wanted();
  }
  mesh_wanted();
  f.ground_copy.finish();
  ASSERT_FALSE(patches.empty());
  for (const auto& [block, mesh] : patches) {
    const Mesh anew = mesh_block(f.ground, block);
    EXPECT_EQ(mesh.points, anew.points);
    EXPECT_EQ(mesh.triangles, anew.triangles);
  }
}

TEST_P(GroundCopyTest, ChunksThatABucketOnlyPassedAreFollowedToo) {
  const std::shared_ptr<const InitialTerrain> slope = make_plane(0.1, {0.5, 0});
  Ground ground(kVoxel, Vec3::Zero(), slope), copy(kVoxel, Vec3::Zero(), slope);
  Tracker tracker(ground, {Bucket{0.6, 0.1, {}, {}}});
  ChangeFollower changes(ground);
  GroundCopy ground_copy(copy, GetParam());
  // Up the slope, 0.1 m above the ground, through chunks of 0.4 m that hold soil.
  for (const double x : {0.0, 1.0}) tracker.update(0, {{x, 0, 0.2 + x / 2}, from_rpy(0, 0, 0)});
  ASSERT_EQ(tracker.total().cut_m3(), 0);
  ASSERT_FALSE(ground.chunks().empty());
  ground_copy.post(ground, changes.take());
  std::uint64_t seen = 0;
  ground_copy.run([&] { seen = copy.state_hash(); });
  ground_copy.finish();
  EXPECT_EQ(seen, ground.state_hash());
}

TEST_P(GroundCopyTest, AnErrorIsThrownOnceAndEverythingElseIsDone) {
  Followed f(make_dig("half_sine", placements()[0]), GetParam());
  int done = 0;
  std::vector<std::string> errors;
  const auto call = [&](auto&& function) {
    try {
      function();
    } catch (const std::runtime_error& e) {
      errors.emplace_back(e.what());
    }
  };
  for (int i = 0; i < 20; ++i) {
    f.update(i / 20.0, (i + 1) / 20.0);
    call([&] { f.post(); });
    call([&] {
      f.ground_copy.run([&, i] {
        ++done;
        if (i == 3 || i == 12) throw std::runtime_error("disk full at " + std::to_string(i));
      });
    });
  }
  call([&] { f.look(); });
  for (int i = 0; i < 3; ++i) call([&] { f.ground_copy.finish(); });
  EXPECT_THAT(errors, ::testing::ElementsAre("disk full at 3", "disk full at 12"));
  EXPECT_EQ(done, 20);
  EXPECT_EQ(f.seen, f.expected);
}

TEST(GroundCopyThread, UpdatesDoNotWaitButWhoAsksForTooManyJobsDoes) {
  Followed f(make_dig("half_sine", placements()[0]), true, 2);
  std::latch started(1), go(1);
  std::atomic<bool> gone = false;
  int done = 0;
  f.ground_copy.run([&] {
    started.count_down();
    go.wait();
    ++done;
  });
  started.wait();
  EXPECT_FALSE(f.ground_copy.done());
  for (int i = 0; i < 2; ++i) {
    f.update(i / 2.0, (i + 1) / 2.0);
    f.post();
    f.ground_copy.run([&] { ++done; });
  }
  for (int i = 0; i < 10; ++i) f.post();
  std::thread opener([&] {
    gone = true;
    go.count_down();
  });
  f.ground_copy.run([&] { ++done; });
  EXPECT_TRUE(gone);  // the two that waited before had to go first
  opener.join();
  f.ground_copy.finish();
  EXPECT_EQ(done, 4);
}

TEST(GroundCopyThread, RunsAllJobsBeforeItEnds) {
  const Dig dig = make_dig("half_sine", placements()[0]);
  Ground ground(kVoxel, dig.origin, dig.terrain), copy(kVoxel, dig.origin, dig.terrain);
  Tracker tracker(ground, {dig.bucket});
  ChangeFollower changes(ground);
  std::vector<std::uint64_t> expected, seen;
  {
    GroundCopy ground_copy(copy);
    const double begin = dig.motion.begin_s(), span = dig.motion.end_s() - begin;
    for (int i = 0; i < 5; ++i) {
      tracker.update(0, dig.motion, begin + span * i / 5, begin + span * (i + 1) / 5);
      ground_copy.post(ground, changes.take());
      expected.push_back(ground.state_hash());
      ground_copy.run([&] { seen.push_back(copy.state_hash()); });
    }
  }
  EXPECT_EQ(seen, expected);
  { const GroundCopy unused(copy); }
}

}  // namespace ground_copy_test
}  // namespace soilvdb::test
