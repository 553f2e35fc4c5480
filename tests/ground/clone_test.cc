// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Clones of ground and of trackers: each is what one dug from scratch would be, whatever becomes of
// those that it shares samples with.
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <random>
#include <stdexcept>
#include <thread>

#include "io/snapshot/swap_file.h"
#include "soilvdb/change_follower.h"
#include "tests/support/earthmoving_fixture.h"
#include "tests/support/sanitized.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace clone_test {

constexpr std::optional<double> kCohesions[] = {{}, 1000, 0};

SampleWords random_set(std::mt19937_64& random) {
  SampleWords words;
  const std::uint64_t sparse = random() % 4;
  for (std::uint64_t& word : words) {
    const std::uint64_t kind = random() % 8;
    word = kind == 0 ? kAllSoil : kind < 2 + sparse ? 0 : random() & random();
  }
  return words;
}

TEST(SharedSamples, AreEachWhatWasWrittenToThem) {
  constexpr std::size_t kCopies = 6;
  std::mt19937_64 random(1);
  std::array<Samples, kCopies> copies;
  std::array<SampleWords, kCopies> model{};
  for (int i = 0; i < 4000; ++i) {
    const std::size_t a = random() % kCopies, b = random() % kCopies;
    const auto n = random() % kChunkVoxels;
    switch (random() % 16) {
      case 0:
        copies[a].assign(model[a] = random_set(random));
        break;
      case 1:
        copies[a].trim();
        break;
      case 2: {
        std::string bytes;
        copies[a].put(bytes);
        std::string_view in = bytes;
        EXPECT_TRUE(copies[b].take(in) && in.empty());
        model[b] = model[a];
        break;
      }
      case 3:
      case 4:
      case 5:
        copies[b] = copies[a];
        model[b] = model[a];
        break;
      case 6: {
        Samples gone = copies[a];
        copies[b] = std::move(gone);
        model[b] = model[a];
        break;
      }
      default:
        model[a][n] = random() % 3 == 0 ? 0 : random() % 2 == 0 ? kAllSoil : random();
        copies[a].set_word(static_cast<int>(n), model[a][n]);
    }
    for (std::size_t c = 0; c < kCopies; ++c) {
      SampleWords words;
      copies[c].expand(words);
      ASSERT_EQ(words, model[c]) << i;
    }
  }
}

/// What is known of a ground's state by other ways than the one that it is kept in.
void expect_same(const Ground& a, const Ground& b) {
  EXPECT_EQ(a.state_hash(), b.state_hash());
  EXPECT_EQ(a.chunk_count(), b.chunk_count());
  EXPECT_EQ(a.active_voxels(), b.active_voxels());
  EXPECT_EQ(a.change_m3(), b.change_m3());
  EXPECT_EQ(a.above_base().min(), b.above_base().min());
  EXPECT_EQ(a.above_base().max(), b.above_base().max());
  const auto chunks = a.chunks();
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    const Chunk* other = b.find(chunks[i]->origin);
    ASSERT_NE(other, nullptr);
    EXPECT_EQ(chunks[i]->soil_count, other->soil_count);
    EXPECT_EQ(chunks[i]->loose_count, other->loose_count);
    EXPECT_EQ(chunks[i]->base_count, other->base_count);
    EXPECT_EQ(chunks[i]->above, other->above);
  }
}
void expect_same(Work& a, Work& b) {
  expect_same(a.ground, b.ground);
  EXPECT_EQ(a.tracker.state(), b.tracker.state());
  EXPECT_EQ(residual(a.tracker), 0);
}

/// Work of which is known what was done.
struct Branch {
  std::unique_ptr<Work> work;
  std::vector<std::uint64_t> done;

  static Branch begin(std::size_t ground) {
    return {std::make_unique<Work>(terrains()[ground], 1, 0.1, kCohesions[ground]), {}};
  }
  Branch clone() const { return {std::make_unique<Work>(*work), done}; }
  void step(std::uint64_t seed) {
    done.push_back(seed);
    work->random.seed(seed);
    work->step();
  }
  /// The same from scratch, on ground that shares nothing.
  Branch again(std::size_t ground) const {
    Branch fresh = begin(ground);
    for (const std::uint64_t seed : done) fresh.step(seed);
    return fresh;
  }
};

TEST(Clone, GoesOnAsTheOriginalWouldToTheLastBit) {
  for (std::size_t g = 0; g < 3; ++g) {
    Branch original = Branch::begin(g);
    ChangeFollower changes(original.work->ground);
    for (std::uint64_t i = 0; i < 120; ++i) {
      original.step(i);
      if (i == 60) changes.take();
    }
    EXPECT_GT(loose_samples(original.work->ground), 0);
    Branch clone = original.clone();
    ChangeFollower of_clone(clone.work->ground, changes);
    expect_same(*original.work, *clone.work);
    EXPECT_EQ(original.work->at.size(), clone.work->at.size());
    for (std::uint64_t i = 200; i < 260; ++i) original.step(i);
    for (std::uint64_t i = 200; i < 260; ++i) clone.step(i);
    expect_same(*original.work, *clone.work);
    expect_same(*original.work, *original.again(g).work);
    const std::vector<Coord3> changed = changes.take();
    EXPECT_FALSE(changed.empty());
    EXPECT_EQ(of_clone.take(), changed) << "since the original's last call";
  }
}

/// A search goes on from any state it had, leaves some, and keeps others.
TEST(Clone, OfAnyGenerationIsWhatOneFromScratchWouldBe) {
  for (std::size_t g = 0; g < 3; ++g) {
    std::mt19937_64 random(g);
    std::vector<Branch> branches;
    branches.push_back(Branch::begin(g));
    for (int i = 0; i < 300; ++i) {
      Branch& branch = branches[random() % branches.size()];
      const std::uint64_t kind = random() % 10;
      if (kind == 0 && branches.size() < 12) {
        Branch clone = branch.clone();
        branches.push_back(std::move(clone));
      } else if (kind == 1 && branches.size() > 4) {
        branch = std::move(branches.back());
        branches.pop_back();
      } else {
        branch.step(random());
      }
    }
    ASSERT_GT(branches.size(), 3u);
    std::size_t least = 1000, most = 0;
    for (const Branch& branch : branches) {
      expect_same(*branch.work, *branch.again(g).work);
      least = std::min(least, branch.done.size());
      most = std::max(most, branch.done.size());
    }
    EXPECT_GT(least, 10u);
    EXPECT_GT(most, least);
  }
}

TEST(Clone, OutlivesTheOriginal) {
  Branch branch = Branch::begin(2);
  for (std::uint64_t generation = 0; generation < 12; ++generation) {
    for (std::uint64_t i = 0; i < 8; ++i) branch.step(100 * generation + i);
    branch = branch.clone();
  }
  expect_same(*branch.work, *branch.again(2).work);
}

/// Soil that doesn't move: machines that are apart dig in parallel.
TEST(Clone, OfRigidSoilDigsAsTheOriginalWould) {
  const Bucket bucket{1, 0.6, {{0, 0}, {-0.4, 0.1}, {0, 0.6}}, {}};
  const auto dig = [](Tracker& tracker, int from, int to) {
    std::vector<double> cuts;
    for (int i = from; i < to; ++i) {
      std::vector<Move> moves(3);
      for (std::size_t m = 0; m < moves.size(); ++m) {
        moves[m].machine = m;
        moves[m].to = {{0.1 * i, 2.0 * static_cast<double>(m), -0.3 * std::sin(0.2 * i)},
                       from_rpy(0, 0.3 * std::cos(0.1 * i), 0.1)};
      }
      for (const Update& update : tracker.update(moves)) cuts.push_back(update.cut_m3);
    }
    return cuts;
  };
  Ground ground(0.05, Vec3(0.01, 0.02, 0.03), make_plane(0, {0.05, 0.1}));
  Tracker tracker(ground, {bucket, bucket, bucket});
  dig(tracker, 0, 40);
  const std::uint64_t hash = ground.state_hash();
  const auto cloned = ground.clone();
  Tracker on_clone(*cloned, tracker);
  const std::vector<double> cuts = dig(tracker, 40, 80);
  EXPECT_EQ(cloned->state_hash(), hash);
  EXPECT_NE(ground.state_hash(), hash);
  EXPECT_EQ(dig(on_clone, 40, 80), cuts);
  expect_same(ground, *cloned);
  EXPECT_EQ(on_clone.state(), tracker.state());
}

TEST(Clone, OfOneSoilMayBeMadeAndChangedByThreadsAtOnce) {
  constexpr std::size_t kClones = 12, kThreads = 4;
  Branch original = Branch::begin(1);
  for (std::uint64_t i = 0; i < 60; ++i) original.step(i);
  const auto grow = [&](std::size_t clone) {
    Branch branch = original.clone();
    for (std::uint64_t i = 0; i < 15; ++i) {
      if (i % 4 == 0) branch = branch.clone();
      branch.step(1000 * clone + i);
    }
    return branch;
  };
  std::vector<Branch> alone, together(kClones);
  for (std::size_t i = 0; i < kClones; ++i) alone.push_back(grow(i));
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    for (std::size_t i = next++; i < kClones; i = next++) together[i] = grow(i);
  };
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < kThreads; ++i) threads.emplace_back(work);
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < kClones; ++i) expect_same(*together[i].work, *alone[i].work);
}

/// The last two of a chunk's owners part from it at once.
TEST(Clone, MayPartFromItsOnlySiblingAtOnce) {
  SampleWords all;
  all.fill(kAllSoil);
  for (std::uint64_t round = 0; round < 40; ++round) {
    std::mt19937_64 random(round);
    Ground a(0.1, Vec3::Zero(), make_plane(0, {0, 0}));
    std::vector<Coord3> chunks;
    for (int i = 0; i < 64; ++i) {
      chunks.emplace_back(8 * i, 0, 8);
      GroundWriter(a).add(chunks.back(), random_set(random));
    }
    const auto b = a.clone();
    const std::uint64_t hash = a.state_hash();
    const auto flip = [&](Ground& ground, std::uint64_t seed) {
      std::mt19937_64 own(seed);
      for (const Coord3& origin : chunks) {
        const SampleWords set = random_set(own);
        SampleWords had;
        ground.read_samples(origin, had);
        GroundWriter(ground).add(origin, set);
        GroundWriter(ground).remove(origin, all);
        GroundWriter(ground).add(origin, had);
      }
    };
    std::thread other([&] { flip(*b, 1); });
    flip(a, 2);
    other.join();
    EXPECT_EQ(a.state_hash(), hash);
    EXPECT_EQ(b->state_hash(), hash);
  }
}

TEST(Clone, TakesTheMemoryOfItsLeavesAndSaysWhatItWouldHold) {
  if (test::kSanitized) GTEST_SKIP() << "sanitizers take memory of their own";
  constexpr std::size_t kClones = 1000;
  Ground ground(0.05, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {digger()});
  for (int lane = 0; lane < 4; ++lane)
    for (const Pose& pose : drag({0, 1.2 * lane, 0}, 4, 0.6, 60)) tracker.update(0, pose);
  ChangeFollower(ground).take();
  double samples = 0;
  for (const Chunk* chunk : ground.chunks()) samples += static_cast<double>(chunk->heap_bytes());
  const auto whole = static_cast<double>(ground.memory_bytes());
  std::vector<std::unique_ptr<Ground>> clones(kClones);
  const std::size_t before = mallinfo2().uordblks;
  for (auto& clone : clones) clone = ground.clone();
  const auto each = static_cast<double>(mallinfo2().uordblks - before) / kClones;
  constexpr double kPieces = 0.05;  // as memory_bytes() may err
  EXPECT_NEAR(each / (whole - samples), 1, kPieces);
  EXPECT_LT(each, whole / 2);
  for (const auto& clone : clones) EXPECT_EQ(clone->memory_bytes(), ground.memory_bytes());
}

TEST(Clone, OfGroundInAColdStoreIsRefused) {
  const test::TempFolder folder;
  Branch branch = Branch::begin(1);
  for (std::uint64_t i = 0; i < 150; ++i) branch.step(i);
  Branch clone = branch.clone();
  Ground& ground = branch.work->ground;
  ground.set_memory_limit(ground.memory_bytes() * 3 / 4,
                          std::make_shared<io::SwapFile>(folder.path()));
  EXPECT_EQ(ground.clone()->state_hash(), ground.state_hash()) << "all of it is here";
  ground.evict();
  try {
    ground.clone();
    FAIL() << "it was cloned";
  } catch (const std::logic_error& error) {
    EXPECT_STREQ(error.what(), "ground in a swap store can't be cloned: the store has one owner");
  }
  const auto chunks = ground.chunks();
  EXPECT_TRUE(std::any_of(chunks.begin(), chunks.end(),
                          [](const Chunk* chunk) { return chunk->swap_record != 0; }));
  // One from before has its samples, however cold the original's are.
  expect_same(clone.work->ground, ground);
  for (std::uint64_t i = 150; i < 170; ++i) clone.step(i);
  expect_same(*clone.work, *clone.again(1).work);
}

TEST(Clone, IsTheOnlySoilThatATrackerIsCopiedOnto) {
  const auto base = std::shared_ptr<const InitialTerrain>(make_plane(0, {0, 0}));
  Ground ground(0.1, Vec3::Zero(), base);
  const Tracker tracker(ground, {digger()}, loam());
  Ground coarser(0.2, Vec3::Zero(), base), shifted(0.1, Vec3(0.1, 0, 0), base),
      other(0.1, Vec3::Zero(), make_plane(0, {0, 0}));
  for (Ground* wrong : {&coarser, &shifted, &other})
    EXPECT_THROW(Tracker(*wrong, tracker), std::invalid_argument);
}

}  // namespace clone_test
}  // namespace soilvdb::test
