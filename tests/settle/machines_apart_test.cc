// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Machines that move soil at once leave the ground, the loads and the state of one after another.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/change_follower.h"
#include "tests/support/earthmoving_fixture.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace machines_apart_test {

constexpr double kVoxel = 0.1;

struct Scene {
  std::shared_ptr<const InitialTerrain> terrain;
  std::vector<Bucket> buckets;
  std::vector<Move> moves;  // of all machines, in order
  std::vector<Pour> pours;
  std::optional<Vec3> tower;  // of loose soil, which somebody else puts there half-way
};

Move move_to(std::size_t machine, const Pose& pose) {
  Move move;
  move.machine = machine;
  move.to = pose;
  return move;
}

/// What is there afterwards.
struct Result {
  std::uint64_t hash;
  std::string state;
  std::vector<double> updates_m3;  // what each says
  std::vector<std::int64_t> balance;
  bool operator==(const Result&) const = default;
};

/// How batches were made, over all results.
Tracker::BatchCounts batches;

/// A chunk of it.
void add_tower(Ground& ground, const Vec3& at) {
  const Coord3 cell = ground.index_from_world(at).array().round().matrix().cast<int>();
  SampleWords all;
  all.fill(kAllSoil);
  GroundWriter(ground).add(floor_to(cell, kChunkSide), all, GroundWriter::Kind::kLoose);
}

/// The moves in batches, with a pour after each eighth of them. @param batch most moves in one
Result result(const Scene& scene, std::size_t batch, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Ground ground(kVoxel, Vec3::Zero(), scene.terrain);
  Tracker tracker(ground, scene.buckets, loam_with_pours(scene.pours));
  Result made;
  const std::size_t part = scene.moves.size() / 8 + 1;
  for (std::size_t from = 0, pours = 0; from < scene.moves.size();) {
    const std::size_t most = std::min(scene.moves.size(), (from / part + 1) * part);
    const std::size_t to = std::min(most, from + 1 + random() % batch);
    for (const Update& u : tracker.update(std::span(scene.moves).subspan(from, to - from)))
      made.updates_m3.insert(made.updates_m3.end(),
                             {u.cut_m3, u.bucket_m3, u.spilled_m3, u.slid_m3});
    from = to;
    if (!scene.tower) {
      EXPECT_EQ(residual(tracker), 0);
    }
    if (from == most && pours < scene.pours.size()) tracker.pour(pours++, 1);
    if (from != 4 * part || !scene.tower) continue;
    add_tower(ground, *scene.tower);
    tracker.pour(0, 1);  // nothing falls yet
  }
  tracker.come_to_rest();
  batches.apart += tracker.batch_counts().apart;
  batches.set_back += tracker.batch_counts().set_back;
  made.hash = ground.state_hash();
  made.state = tracker.state();
  const MassBalance m = tracker.mass_balance();
  made.balance = {m.ground, m.pending, m.lost_off_terrain, m.slid, m.fill_samples};
  return made;
}

void expect_same(const Scene& scene, std::uint64_t seed) {
  const Result in_turn = result(scene, 1, 0);
  for (const std::size_t threads : {1, 4}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const std::size_t batch = threads == 1 ? 40 : scene.moves.size();
    EXPECT_TRUE(result(scene, batch, seed) == in_turn) << threads << " threads, " << batch;
  }
}

/// Each machine's poses, one of each in turn.
std::vector<Move> in_step(const std::vector<std::vector<Pose>>& paths) {
  std::vector<Move> moves;
  bool any = true;
  for (std::size_t i = 0; any; ++i) {
    any = false;
    for (std::size_t m = 0; m < paths.size(); ++m) {
      if (i >= paths[m].size()) continue;
      moves.push_back(move_to(m, paths[m][i]));
      any = true;
    }
  }
  return moves;
}

Pose turned(const Vec3& about, double yaw, const Pose& pose) {
  const Eigen::Quaterniond turn = from_rpy(0, 0, yaw);
  return {about + turn * (pose.position - about), turn * pose.rotation};
}

double wavy(double x, double y) { return 1.2 * std::sin(0.11 * x) + 0.8 * std::cos(0.17 * y); }

TEST(MachinesApart, AtOnceAsInTurn) {
  batches = {};
  for (std::uint64_t seed = 1; seed <= (kLong ? 20u : kSanitized ? 1u : 2u); ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto draw = [&](double low, double high) {
      return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
    };
    HeightGrid grid;
    grid.nx = grid.ny = 161;
    grid.first = {-80, -80};
    grid.spacing = {1, 1};
    Scene scene{
        raster(grid, wavy), {}, {}, {{"a", {0, 0, 6}, 0, 0, 2}, {"b", {9, 1, 6}, 0, 0, 1}}, {}};
    // Some beside each other, some far from all.
    std::vector<std::vector<Pose>> paths;
    for (int m = 0; m < 5; ++m) {
      Bucket bucket = digger();
      if (m % 2 == 1) bucket.dump_angle_rad = 1.0;
      scene.buckets.push_back(bucket);
      Vec3 at(draw(-45, 45), draw(-45, 45), 0);
      if (m == 4) at = paths[0].front().position + Vec3(draw(-6, 6), draw(-6, 6), 0);
      at.z() = wavy(at.x(), at.y());
      const double yaw = draw(-3, 3);
      std::vector<Pose> path;
      for (int n = 0; n < 2; ++n)
        for (const Pose& pose : cycle(at + Vec3(0, 0.4 * n, 0), draw(0.3, 0.8), 40, draw(3, 6)))
          path.push_back(turned(at, yaw, pose));
      if (m == 2) path.resize(path.size() / 2);  // stands with its bucket up, or in the ground
      paths.push_back(std::move(path));
    }
    scene.moves = in_step(paths);
    expect_same(scene, seed);
  }
  EXPECT_GT(batches.apart, 0u);
}

TEST(MachinesApart, WhatSomebodyElsePutsThereComesToRest) {
  std::vector<std::vector<Pose>> paths;
  for (const double x : {-20.0, 20.0}) paths.push_back(cycle({x, 0, 0}, 0.5, 40));
  Scene scene{make_plane(0, {0, 0}), {digger(), digger()}, in_step(paths), {}, {}};
  scene.pours = {{"later", {0, 0, 6}, 1000, 1000, 1}};
  const std::int64_t slid = result(scene, 1, 0).balance[3],
                     tower = 512 * 64 * MassUnits(*loam().soil).loose;
  for (const Vec3& at : {Vec3(-20, 2, 0.4), Vec3(0, 0, 0.4), Vec3(60, 60, 0.4)}) {
    if (kSanitized && at.x() >= 0) break;
    scene.tower = at;
    expect_same(scene, 1);
    EXPECT_GT(result(scene, 1, 0).balance[3], slid + tower / 10) << "it slides";
  }
}

double foot_of_slope(double x, double) { return std::max(0.0, x + 3); }

// The lower machine may have moved on when soil of the upper one comes to its trench.
TEST(MachinesApart, SoilThatRunsDownToAnotherMachineMeetsItsGround) {
  HeightGrid grid;
  grid.nx = grid.ny = 201;
  grid.first = {-30, -50};
  grid.spacing = {0.5, 0.5};
  Scene scene{raster(grid, foot_of_slope), {digger(), digger()}, {}, {}, {}};
  const Vec3 upper(40, 0, 43), lower(-3, 0.5, 0);
  const double down = std::numbers::pi;
  std::vector<Pose> digs, tips;
  for (const Pose& pose : cycle(lower, 1.0, 40)) digs.push_back(turned(lower, 1.57, pose));
  for (const Pose& pose : cycle(upper, 0.8, 40, 1)) tips.push_back(turned(upper, down, pose));
  scene.moves = in_step({tips, digs});
  batches = {};
  expect_same(scene, 1);
  if (!kSanitized) expect_same(scene, 2);
  EXPECT_GT(batches.set_back, 0u);
}

double pit(double x, double y) {
  return std::hypot(x - 30, y) < 3 ? std::numeric_limits<double>::quiet_NaN() : 0;
}

// A move that can't be made leaves what the moves before it left.
TEST(MachinesApart, AMoveWithoutGroundEndsThemInItsTurn) {
  HeightGrid grid;
  grid.nx = 241;
  grid.ny = 161;
  grid.first = {-40, -40};
  grid.spacing = {0.5, 0.5};
  const std::vector<Pose> there = cycle({0, 0, 0}, 0.5, 40), hole = drag({26, 0, 0}, 6, 0.5, 40);
  const std::vector<Move> moves = in_step({there, hole});
  Result made[2];
  for (const bool at_once : {false, true}) {
    Ground ground(kVoxel, Vec3::Zero(), raster(grid, pit));
    Tracker tracker(ground, {digger(), digger()}, loam());
    if (at_once) {
      EXPECT_THROW(tracker.update(moves), NoGroundError);
    } else {
      EXPECT_THROW(for (const Move& move
                        : moves) tracker.update(move.machine, move.to),
                   NoGroundError);
    }
    made[at_once] = {ground.state_hash(), tracker.state(), {}, {}};
  }
  EXPECT_TRUE(made[0] == made[1]);
}

TEST(GroundUndo, SetsBackWhatWasEditedAndNothingElse) {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    std::mt19937_64 random(seed);
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0.2, -0.1}));
    GroundWriter writer(ground);
    const auto edit_some = [&](int count) {
      for (int i = 0; i < count; ++i) {
        const auto chunk = [&] { return kChunkSide * static_cast<int>(random() % 5) - 16; };
        const Coord3 origin(chunk(), chunk(), chunk());
        SampleWords words;
        for (std::uint64_t& word : words) word = random() % 3 == 0 ? random() : 0;
        if (random() % 2 == 0)
          writer.remove(origin, words);
        else
          writer.add(origin, words, GroundWriter::Kind::kLoose);
      }
    };
    edit_some(60);
    const std::unique_ptr<Ground> before = copy_of(ground);
    ASSERT_EQ(before->state_hash(), ground.state_hash());
    ChangeFollower changes(ground);
    changes.take();
    {
      GroundUndo undo(ground);
      edit_some(60);
      ASSERT_NE(before->state_hash(), ground.state_hash());
      undo.undo();
      EXPECT_EQ(before->state_hash(), ground.state_hash());
      EXPECT_EQ(before->chunk_count(), ground.chunk_count());
      EXPECT_EQ(before->active_voxels(), ground.active_voxels());
      EXPECT_EQ(before->change_m3(), ground.change_m3());
      EXPECT_FALSE(changes.take().empty());
      edit_some(10);  // again, after it was set back
      undo.undo();
      EXPECT_EQ(before->state_hash(), ground.state_hash());
    }
    EXPECT_TRUE(changes.take().empty()) << "as if nothing had been";
    edit_some(10);
    EXPECT_NE(before->state_hash(), ground.state_hash()) << "it is over";
  }
}

}  // namespace machines_apart_test
}  // namespace soilvdb::test
