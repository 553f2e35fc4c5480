// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Meshes and jobs beside updates: they see what they would have seen had updates waited for them.
#include "soilvdb/ground_service.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <latch>
#include <stdexcept>

#include "tests/support/dig_runner.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace ground_service_test {

constexpr double kVoxel = 0.05;

using Patches = std::map<Coord3, Mesh, SurfaceMesh::Less>;

/// A dig that is followed by a service.
struct Followed {
  Dig dig;
  Soil soil, copy;
  Tracker tracker;
  GroundService service;
  Patches patches;

  Followed(Dig d, const GroundService::Options& options)
      : dig(std::move(d)),
        soil(kVoxel, dig.origin, dig.ground),
        copy(kVoxel, dig.origin, dig.ground),
        tracker(soil, {dig.bucket}),
        service(copy, options) {}

  /// Digs a part of the motion, from 0 to 1, in one update.
  void update(double from, double to) {
    const double begin = dig.motion.begin_s(), span = dig.motion.end_s() - begin;
    tracker.update(0, dig.motion, begin + span * from, begin + span * to);
  }
  void post() { service.post(soil, tracker.take_changed()); }
  void take() {
    for (GroundService::Patch& patch : service.take_patches()) {
      EXPECT_LE(patch.first_post, patch.last_post);
      if (patch.mesh.triangles.empty()) {
        patches.erase(patch.block);
      } else {
        patches[patch.block] = std::move(patch.mesh);
      }
    }
  }
};

/// All patches of the ground, meshed anew.
Patches patches_of(const Soil& soil) {
  std::vector<Coord3> all;
  for (const Chunk* chunk : soil.chunks()) all.push_back(chunk->origin);
  SurfaceMesh mesh(soil);
  mesh.update(all);
  return mesh.patches();
}

bool same(const Mesh& a, const Mesh& b) {
  return a.points == b.points && a.triangles == b.triangles;
}

void expect_same(const Patches& a, const Patches& b) {
  ASSERT_EQ(a.size(), b.size());
  for (auto i = a.begin(), j = b.begin(); i != a.end(); ++i, ++j) {
    ASSERT_EQ(i->first, j->first);
    EXPECT_TRUE(same(i->second, j->second)) << "block " << i->first.transpose();
  }
}

class GroundServiceTest : public ::testing::TestWithParam<bool> {
 protected:
  GroundService::Options options() const { return {GetParam(), true, 4}; }
};

INSTANTIATE_TEST_SUITE_P(Threads, GroundServiceTest, ::testing::Bool(),
                         [](const auto& thread) { return thread.param ? "OneOfItsOwn" : "None"; });

TEST_P(GroundServiceTest, PatchesAreThoseOfTheGroundBitForBit) {
  constexpr int kUpdates = 60;
  const std::size_t one_of = test::kLong ? 1 : test::kSanitized ? 4 : 3;
  int n = 0;
  for (std::size_t k = 0; k < families().size(); k += one_of) {
    const std::string& family = families()[k];
    for (const int updates_per_post : {1, 7}) {
      SCOPED_TRACE(family + ", a post every " + std::to_string(updates_per_post));
      const std::size_t at = static_cast<std::size_t>(++n) % placements().size();
      Followed f(make_dig(family, placements()[at]), options());
      for (int i = 0; i < kUpdates; ++i) {
        f.update(double(i) / kUpdates, double(i + 1) / kUpdates);
        if (i % updates_per_post == 0) f.post();
        f.take();
        if (i != kUpdates / 2) continue;
        f.post();
        f.service.finish();
        f.take();
        expect_same(f.patches, patches_of(f.soil));
      }
      f.post();
      f.service.finish();
      f.take();
      ASSERT_GT(f.tracker.total().captured, 0);
      expect_same(f.patches, patches_of(f.soil));
      EXPECT_TRUE(same(weld(f.patches), mesh_all(f.soil)));
      EXPECT_EQ(f.copy.state_hash(), f.soil.state_hash());
    }
  }
}

TEST_P(GroundServiceTest, ChunksThatABucketOnlyPassedAreFollowedToo) {
  const std::shared_ptr<const BaseSurface> slope = make_plane(0.1, {0.5, 0});
  Soil soil(kVoxel, Vec3::Zero(), slope), copy(kVoxel, Vec3::Zero(), slope);
  Tracker tracker(soil, {Bucket{0.6, 0.1, {}, {}}});
  GroundService service(copy, options());
  // Up the slope, 0.1 m above the ground, through chunks of 0.4 m that hold soil.
  for (const double x : {0.0, 1.0}) tracker.update(0, {{x, 0, 0.2 + x / 2}, from_rpy(0, 0, 0)});
  ASSERT_EQ(tracker.total().cut_m3(), 0);
  ASSERT_FALSE(soil.chunks().empty());
  service.post(soil, tracker.take_changed());
  service.finish();
  EXPECT_EQ(copy.state_hash(), soil.state_hash());
  Patches patches;
  for (GroundService::Patch& patch : service.take_patches()) {
    if (!patch.mesh.triangles.empty()) patches[patch.block] = std::move(patch.mesh);
  }
  expect_same(patches, patches_of(soil));
}

TEST_P(GroundServiceTest, AJobSeesTheGroundAsItWasWhenItWasAskedFor) {
  constexpr int kUpdates = 40;
  Followed f(make_dig("drag_curl_retreat", placements()[1]), options());
  std::vector<std::uint64_t> expected, seen;
  for (int i = 0; i < kUpdates; ++i) {
    f.update(double(i) / kUpdates, double(i + 1) / kUpdates);
    if (i % 3 != 0) continue;
    f.post();
    expected.push_back(f.soil.state_hash());
    f.service.run([&] { seen.push_back(f.copy.state_hash()); });
  }
  f.service.finish();
  EXPECT_EQ(seen, expected);
}

TEST_P(GroundServiceTest, ABlockThatIsTheSameIsNotMeshedAgain) {
  Followed f(make_dig("half_sine", placements()[0]), options());
  for (int i = 0; i < 20; ++i) f.update(i / 20.0, (i + 1) / 20.0);
  f.post();
  f.service.finish();
  const std::uint64_t meshed = f.service.blocks_meshed();
  EXPECT_GT(meshed, 0u);
  f.service.post(f.soil, {});
  std::vector<Coord3> all;
  for (const Chunk* chunk : f.soil.chunks()) all.push_back(chunk->origin);
  f.service.post(f.soil, all);
  f.service.finish();
  EXPECT_EQ(f.service.blocks_meshed(), meshed);
}

TEST_P(GroundServiceTest, AnErrorIsThrownOnceAndEverythingElseIsDone) {
  Followed f(make_dig("half_sine", placements()[0]), options());
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
      f.service.run([&, i] {
        ++done;
        if (i == 3 || i == 12) throw std::runtime_error("disk full at " + std::to_string(i));
      });
    });
  }
  for (int i = 0; i < 3; ++i) call([&] { f.service.finish(); });
  EXPECT_THAT(errors, ::testing::ElementsAre("disk full at 3", "disk full at 12"));
  EXPECT_EQ(done, 20);
  EXPECT_EQ(f.copy.state_hash(), f.soil.state_hash());
  f.take();
  expect_same(f.patches, patches_of(f.soil));
}

TEST(GroundServiceThread, MeshesABlockOnceHoweverOftenItWasAskedForBeforeItsTurn) {
  const Dig dig = make_dig("half_sine", placements()[0]);
  constexpr int kUpdates = 50;
  Followed busy(dig, {}), idle(dig, {});
  std::latch go(1);
  busy.service.run([&] { go.wait(); });
  for (int i = 0; i < kUpdates; ++i) {
    for (Followed* f : {&busy, &idle}) {
      f->update(double(i) / kUpdates, double(i + 1) / kUpdates);
      f->post();
    }
    idle.service.finish();
  }
  go.count_down();
  busy.service.finish();
  busy.take();
  idle.take();
  expect_same(busy.patches, patches_of(busy.soil));
  expect_same(busy.patches, idle.patches);
  std::vector<Coord3> all;
  for (const Chunk* chunk : busy.soil.chunks()) all.push_back(chunk->origin);
  EXPECT_EQ(busy.service.blocks_meshed(), blocks_touched(all).size());
  EXPECT_GT(idle.service.blocks_meshed(), 5 * busy.service.blocks_meshed());
}

TEST(GroundServiceThread, UpdatesDoNotWaitButWhoAsksForTooManyJobsDoes) {
  Followed f(make_dig("half_sine", placements()[0]), {true, true, 2});
  std::latch started(1), go(1);
  std::atomic<bool> gone = false;
  int done = 0;
  f.service.run([&] {
    started.count_down();
    go.wait();
    ++done;
  });
  started.wait();
  for (int i = 0; i < 2; ++i) {
    f.update(i / 2.0, (i + 1) / 2.0);
    f.post();
    f.service.run([&] { ++done; });
  }
  std::thread opener([&] {
    gone = true;
    go.count_down();
  });
  f.service.run([&] { ++done; });
  EXPECT_TRUE(gone);  // the two that waited before had to go first
  opener.join();
  f.service.finish();
  EXPECT_EQ(done, 4);
}

TEST(GroundServiceThread, RunsAllJobsBeforeItEnds) {
  Dig dig = make_dig("half_sine", placements()[0]);
  Soil soil(kVoxel, dig.origin, dig.ground), copy(kVoxel, dig.origin, dig.ground);
  Tracker tracker(soil, {dig.bucket});
  std::vector<std::uint64_t> expected, seen;
  {
    GroundService service(copy, {});
    const double begin = dig.motion.begin_s(), span = dig.motion.end_s() - begin;
    for (int i = 0; i < 5; ++i) {
      tracker.update(0, dig.motion, begin + span * i / 5, begin + span * (i + 1) / 5);
      service.post(soil, tracker.take_changed());
      expected.push_back(soil.state_hash());
      service.run([&] { seen.push_back(copy.state_hash()); });
    }
  }
  EXPECT_EQ(seen, expected);
  { const GroundService unused(copy, {}); }
}

}  // namespace ground_service_test
}  // namespace soilvdb::test
