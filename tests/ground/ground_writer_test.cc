// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Laws of the one writer, against a plain boolean model of a small site; and the tree it writes.
#include "core/ground/ground_writer.h"

#include <gtest/gtest.h>
#include <openvdb/tree/LeafManager.h>
#include <openvdb/tree/NodeManager.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <map>
#include <random>
#include <set>

#include "core/lattice/chunk_math.h"
#include "io/snapshot/swap_file.h"
#include "soilvdb/change_follower.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/sample_tree.h"
#include "soilvdb/tracker.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace ground_writer_test {

constexpr double kVoxel = 0.1;

SampleWords random_set(std::mt19937_64& random) {
  SampleWords words;
  const std::uint64_t sparse = random() % 4;
  for (std::uint64_t& word : words) {
    const std::uint64_t kind = random() % 8;
    word = kind == 0 ? kAllSoil : kind < 2 + sparse ? 0 : random() & random();
  }
  return words;
}

/// A soil and what it should be: a word for each cell of a few chunks around the ground's surface.
struct Modelled {
  Ground ground{kVoxel, Vec3::Zero(), make_plane(0.13, {0.2, -0.1})};
  GroundWriter writer{ground};
  std::map<Coord3, SampleWords, Before> model;
  std::set<Coord3, Before> changed;

  Modelled() {
    for (int x = -16; x < 16; x += 8)
      for (int y = -16; y < 16; y += 8)
        for (int z = -24; z < 24; z += 8) ground.read_base({x, y, z}, model[{x, y, z}]);
  }
  Coord3 any(std::mt19937_64& random) const {
    return std::next(model.begin(), static_cast<std::ptrdiff_t>(random() % model.size()))->first;
  }
  void change(const Coord3& origin, const SampleWords& set, bool add) {
    SampleWords& words = model.at(origin);
    std::int64_t count = 0;
    for (std::size_t n = 0; n < words.size(); ++n) {
      const std::uint64_t now = add ? words[n] | set[n] : words[n] & ~set[n];
      count += std::popcount(words[n] ^ now);
      words[n] = now;
    }
    EXPECT_EQ(add ? writer.add(origin, set) : writer.remove(origin, set), count);
    if (count > 0) changed.insert(origin);
  }
  void expect_same() const {
    SampleWords words;
    std::uint64_t active = 0;
    std::int64_t change = 0;
    for (const auto& [origin, expected] : model) {
      ground.read_samples(origin, words);
      ASSERT_EQ(words, expected);
      std::int64_t count = 0, base = 0, cells = 0;
      for (const std::uint64_t word : expected) {
        count += std::popcount(word);
        cells += word != 0;
      }
      ground.read_base(origin, words);
      for (const std::uint64_t word : words) base += std::popcount(word);
      change += count - base;
      if (const Chunk* chunk = ground.find(origin)) {
        EXPECT_EQ(chunk->soil_count, count);
        EXPECT_EQ(chunk->base_count, base);
        active += static_cast<std::uint64_t>(cells);
      } else {
        EXPECT_EQ(count, base);
      }
      expect_bounds(origin, expected);
    }
    EXPECT_EQ(ground.active_voxels(), active);
    EXPECT_EQ(ground.change_m3(), static_cast<double>(change) * ground.sample_m3());
  }
  /// The box of a cell that holds soil is no air; one above all is.
  void expect_bounds(const Coord3& origin, const SampleWords& words) const {
    for (int n = 0; n < kChunkVoxels; n += 5) {
      if (words[static_cast<std::size_t>(n)] == 0) continue;
      const Vec3 middle = ground.world_from_index((origin + numbered_voxel(n)).cast<double>());
      const Vec3 part = Vec3::Constant(0.5 * kVoxel);
      EXPECT_FALSE(ground.is_air({middle - part, middle + part}));
    }
    EXPECT_TRUE(ground.is_air({Vec3(-1, -1, 5), Vec3(1, 1, 6)}));
  }
};

TEST(GroundWriter, RemovingAndAddingTheSameIsTheIdentity) {
  std::mt19937_64 random(1);
  Modelled m;
  for (int i = 0; i < 200; ++i) m.change(m.any(random), random_set(random), i % 2 == 0);
  const std::uint64_t hash = m.ground.state_hash();
  for (int i = 0; i < 200; ++i) {
    const Coord3 origin = m.any(random);
    if (m.ground.find(origin) == nullptr) continue;
    SampleWords set = random_set(random);
    const auto before = m.model.at(origin);
    for (std::size_t n = 0; n < set.size(); ++n) set[n] &= i % 2 ? before[n] : ~before[n];
    m.change(origin, set, i % 2 == 0);
    m.change(origin, set, i % 2 != 0);
    ASSERT_EQ(m.ground.state_hash(), hash);
  }
}

TEST(GroundWriter, RandomSetsComeAndGoAsInAPlainModel) {
  for (const bool limited : {false, true}) {
    std::mt19937_64 random(2);
    const test::TempFolder folder;
    Modelled m;
    ChangeFollower changes(m.ground);
    if (limited) m.ground.set_memory_limit(90'000, std::make_shared<io::SwapFile>(folder.path()));
    int swapped = 0;
    for (int i = 0; i < 2000; ++i) {
      m.change(m.any(random), random_set(random), random() % 2 == 0);
      if (!limited || i % 3 != 0) continue;
      m.ground.evict();
      EXPECT_LE(m.ground.memory_bytes(), 90'000u);
      for (const Chunk* chunk : m.ground.chunks()) swapped += chunk->swap_record != 0;
      if (i % 100 == 0) m.expect_same();
    }
    EXPECT_EQ(swapped > 0, limited);
    m.expect_same();
    const std::vector<Coord3> touched = changes.take();
    EXPECT_TRUE(std::is_sorted(touched.begin(), touched.end(), before));
    EXPECT_TRUE(
        std::includes(touched.begin(), touched.end(), m.changed.begin(), m.changed.end(), before));
    EXPECT_TRUE(changes.take().empty());
  }
}

TEST(GroundWriter, WhatComesGoesOrChangesIsTouched) {
  std::mt19937_64 random(3);
  Modelled m;
  ChangeFollower changes(m.ground);
  changes.take();
  for (int i = 0; i < 300; ++i) {
    const Coord3 origin = m.any(random);
    const std::uint64_t kind = random() % 4;
    m.changed.clear();
    if (kind == 0 && m.ground.find(origin) != nullptr) {
      m.writer.drop(origin);
      m.ground.read_base(origin, m.model.at(origin));
      m.changed.insert(origin);
    } else {
      m.change(origin, random_set(random), kind % 2 == 0);
    }
    const std::vector<Coord3> touched = changes.take();
    for (const Coord3& c : m.changed) EXPECT_EQ(std::count(touched.begin(), touched.end(), c), 1);
    EXPECT_LE(touched.size(), 1u) << "nothing else happened";
  }
  m.expect_same();
}

TEST(GroundWriter, ACopyOfEveryChunkIsTheSameGround) {
  std::mt19937_64 random(4);
  Modelled m;
  for (int i = 0; i < 300; ++i) m.change(m.any(random), random_set(random), i % 3 == 0);
  Ground copy(kVoxel, Vec3::Zero(), m.ground.shared_terrain());
  for (const Chunk* chunk : m.ground.chunks())
    GroundWriter(copy).copy_from(m.ground, chunk->origin);
  EXPECT_EQ(copy.state_hash(), m.ground.state_hash());
  EXPECT_EQ(copy.active_voxels(), m.ground.active_voxels());
  const Eigen::AlignedBox3d above(Vec3(-1.6, -1.6, 1.5), Vec3(1.6, 1.6, 2.3));
  EXPECT_FALSE(m.ground.is_air(above));
  EXPECT_FALSE(copy.is_air(above));
}

TEST(GroundWriter, ACutInWhatWasFilledAboveTheBaseSurfaceIsFound) {
  for (const bool body : {false, true}) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    SampleWords all;
    all.fill(kAllSoil);
    EXPECT_EQ(GroundWriter(ground).add({0, 0, 32}, all), 512 * 64);
    Bucket bucket{0.4, 0.3, {}, {}};
    if (body) bucket.profile = {{0, 0}, {-0.2, 0}, {0, 0.3}};
    Tracker tracker(ground, {bucket});
    const auto to = [](double x, double z) { return Pose{{x, 0.4, z}}; };
    tracker.update(0, to(-1, 3.4));
    EXPECT_EQ(tracker.update(0, to(-0.5, 3.4)).cut_m3, 0);
    EXPECT_NEAR(tracker.update(0, to(2, 3.4)).cut_m3, 0.4 * 0.3 * 0.8, 1e-3);
    EXPECT_EQ(tracker.update(0, to(2, 6)).cut_m3, 0);
    EXPECT_EQ(tracker.update(0, to(-1, 6)).cut_m3, 0);
    EXPECT_EQ(ground.chunk_count(), 1u);
    // A bucket that starts there clears what its body is in.
    Tracker other(ground, {bucket});
    EXPECT_EQ(other.update(0, to(0.4, 3.8)).cut_m3 > 0, body);
  }
}

TEST(GroundWriter, SeveralInDifferentChunksAtOnceGiveTheSameBits) {
  constexpr std::size_t kWriters = 8;
  const auto fill = [](std::size_t threads) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0.1, 0.05}));
    std::atomic<std::int64_t> count = 0;
    tbb::parallel_for(std::size_t{0}, kWriters, [&](std::size_t w) {
      std::mt19937_64 random(w);
      GroundWriter writer(ground);
      for (int i = 0; i < 200; ++i) {
        const Coord3 origin(8 * static_cast<int>(kWriters * (random() % 9) + w),
                            8 * static_cast<int>(random() % 5), 8 * static_cast<int>(random() % 6));
        const SampleWords set = random_set(random);
        count += random() % 2 ? writer.add(origin, set) : -writer.remove(origin, set);
        ground.is_air({Vec3(0, 0, 1), Vec3(50, 3, 2)});
      }
    });
    EXPECT_NEAR(ground.change_m3(), static_cast<double>(count) * ground.sample_m3(), 1e-12);
    return ground.state_hash();
  };
  const std::uint64_t hash = fill(1);
  for (const std::size_t threads : {2u, 4u, 8u}) {
    for (int run = 0; run < 5; ++run) EXPECT_EQ(fill(threads), hash) << threads;
  }
}

TEST(GroundWriter, AnErrorOnTheWayLeavesWhatWasChangedListedAndCounted) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  ChangeFollower changes(ground);
  const std::vector<GroundWriter::Edit> edits = {{{0, 0, -8}}, {{8, 0, -8}}, {{16, 0, -8}}};
  const auto change = [](std::size_t i, Samples& samples, Samples&) {
    if (i == 1) throw std::runtime_error("no more");
    samples.set_word(3, 0);
    return true;
  };
  EXPECT_THROW(GroundWriter(ground).edit(GroundWriter::Operation::kRemove, edits, 100, change),
               std::runtime_error);
  EXPECT_EQ(changes.take(), (std::vector<Coord3>{edits[0].origin, edits[1].origin}));
  EXPECT_EQ(ground.change_m3(), -64 * ground.sample_m3());
}

TEST(SampleTree, WorksWithWhatOpenVdbHasForTrees) {
  std::mt19937_64 random(5);
  Modelled m;
  for (int i = 0; i < 300; ++i) m.change(m.any(random), random_set(random), i % 2 == 0);
  EXPECT_EQ(m.ground.grid().indexToWorld(openvdb::Coord(1, -2, 3)),
            m.ground.voxel_size_m() * openvdb::Vec3d(1, -2, 3));
  const SampleTree& tree = m.ground.grid().tree();
  EXPECT_EQ(tree.leafCount(), m.ground.chunk_count());
  EXPECT_EQ(tree.treeType(), "Tree_soil_samples_3_2_3");
  openvdb::tree::ValueAccessor<const SampleTree, false> values(tree);
  std::uint64_t on = 0;
  for (const auto& [origin, words] : m.model) {
    for (int n = 0; n < kChunkVoxels; ++n) {
      const Coord3 voxel = origin + numbered_voxel(n);
      const openvdb::Coord at(voxel.x(), voxel.y(), voxel.z());
      const bool soil = m.ground.find(origin) != nullptr && words[static_cast<std::size_t>(n)] != 0;
      ASSERT_EQ(values.isValueOn(at), soil);
      on += soil;
    }
  }
  EXPECT_EQ(tree.activeVoxelCount(), on);
  std::uint64_t iterated = 0;
  for (auto value = tree.cbeginValueOn(); value; ++value) ++iterated;
  EXPECT_EQ(iterated, on);
  std::atomic<std::uint64_t> counted = 0;
  openvdb::tree::LeafManager<const SampleTree> leaves(tree);
  leaves.foreach ([&](const SampleLeaf& leaf, std::size_t) { counted += leaf.onVoxelCount(); });
  EXPECT_EQ(counted, on);
  counted = 0;
  const auto visit = [&](const auto& node) {
    if constexpr (std::is_same_v<std::decay_t<decltype(node)>, SampleLeaf>)
      counted += node.chunk.soil_count > 0;
  };
  openvdb::tree::NodeManager<const SampleTree> nodes(tree);
  nodes.foreachTopDown(visit);
  EXPECT_GT(counted, 0u);
  const SampleTree copy(tree);  // deep
  EXPECT_EQ(copy.probeConstLeaf(tree.cbeginLeaf()->origin())->chunk.samples,
            tree.cbeginLeaf()->chunk.samples);
  using Mask = SampleTree::ValueConverter<openvdb::ValueMask>::Type;
  EXPECT_EQ(Mask(tree, false, openvdb::TopologyCopy()).activeVoxelCount(), on);
}

// Else what a machine finds would depend on what others do far away.
TEST(GroundWriter, AirStaysAirWhateverIsRaisedElsewhere) {
  Ground ground(0.1, Vec3::Zero(), make_plane(0, {0.5, 0}));
  GroundWriter writer(ground);
  SampleWords some;
  some.fill(1);
  writer.remove({0, 0, 0}, some);  // a chunk with soil in its higher half
  const Eigen::AlignedBox3d air(Vec3(0, 0, 0.25), Vec3(0.1, 0.1, 0.35));
  ASSERT_NE(ground.find({0, 0, 0}), nullptr);
  EXPECT_TRUE(ground.is_air(air));
  for (const Coord3& origin : {Coord3(-16, -16, 0), Coord3(16, 16, 16)}) {
    writer.add(origin, some, GroundWriter::Kind::kLoose);
    EXPECT_TRUE(ground.is_air(air));
  }
  ASSERT_TRUE(ground.above_base().contains(Coord3(0, 0, 3)));
  writer.add({0, 0, 0}, some, GroundWriter::Kind::kLoose);
  EXPECT_FALSE(ground.is_air(air));
}

// Else what a machine finds would depend on where its soil lies in a chunk.
TEST(GroundWriter, BetweenCellsWithSoilIsAir) {
  for (const Coord3& shift : {Coord3(0, 0, 0), Coord3(3, 1, 2), Coord3(5, 6, 7)}) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(-10, {0, 0}));
    GroundWriter writer(ground);
    const auto middle = [&](const Coord3& cell) {
      return ground.world_from_index((cell + shift).cast<double>());
    };
    const Coord3 cells[] = {{0, 0, 16}, {3, 3, 19}};
    for (const Coord3& cell : cells) {
      const Coord3 at = cell + shift, origin = floor_to(at, kChunkSide), in = at - origin;
      SampleWords words{};
      words[static_cast<std::size_t>(in.x() << 6 | in.y() << 3 | in.z())] = 1;
      writer.add(origin, words, GroundWriter::Kind::kLoose);
    }
    const Vec3 half = Vec3::Constant(0.4 * kVoxel);
    for (int x = 0; x < 4; ++x)
      for (int y = 0; y < 4; ++y)
        for (int z = 16; z < 20; ++z) {
          const Coord3 cell(x, y, z);
          const bool is_soil = cell == cells[0] || cell == cells[1];
          EXPECT_EQ(ground.is_air({middle(cell) - half, middle(cell) + half}), !is_soil);
        }
  }
}

}  // namespace ground_writer_test
}  // namespace soilvdb::test
