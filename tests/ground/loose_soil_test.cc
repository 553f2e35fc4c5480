// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Which soil is loose, through all that keeps, copies and cuts the ground, against a plain model.
#include <gtest/gtest.h>

#include <bit>
#include <map>
#include <memory>
#include <random>

#include "core/cut/excavator.h"
#include "core/ground/ground_writer.h"
#include "io/snapshot/swap_file.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/sample_tree.h"
#include "soilvdb/tracker.h"
#include "tests/support/snapshot_fixture.h"

namespace soilvdb::test {
namespace loose_soil_test {

constexpr double kVoxel = 0.1;

SampleWords random_set(std::mt19937_64& random) {
  SampleWords words;
  for (std::uint64_t& word : words) {
    const std::uint64_t kind = random() % 6;
    word = kind == 0 ? kAllSoil : kind < 3 ? 0 : random() & random();
  }
  return words;
}

/// A ground, and what is loose of it.
struct Heaps {
  Ground ground{kVoxel, Vec3::Zero(), make_plane(0.13, {0.2, -0.1})};
  GroundWriter writer{ground};
  std::map<Coord3, SampleWords, Before> loose;

  void change(std::mt19937_64& random) {
    const auto at = [&] { return static_cast<int>(random() % 4) * 8 - 16; };
    const Coord3 origin(at(), at(), at());
    const SampleWords set = random_set(random);
    SampleWords soil_before;
    ground.read_samples(origin, soil_before);
    SampleWords& model = loose[origin];
    const std::uint64_t kind = random() % 3;
    for (std::size_t n = 0; n < model.size(); ++n) {
      if (kind == 0) model[n] &= ~set[n];
      if (kind == 1) model[n] |= set[n] & ~soil_before[n];
    }
    if (kind == 0) writer.remove(origin, set);
    if (kind == 1) writer.add(origin, set, GroundWriter::Kind::kLoose);
    if (kind == 2) writer.add(origin, set);
  }
};

void expect_loose(const Ground& ground, const std::map<Coord3, SampleWords, Before>& model) {
  SampleWords words, samples;
  for (const auto& [origin, expected] : model) {
    ground.read_loose(origin, words);
    ASSERT_EQ(words, expected);
    ground.read_samples(origin, samples);
    int count = 0;
    for (std::size_t n = 0; n < words.size(); ++n) {
      ASSERT_EQ(words[n] & ~samples[n], 0u);
      count += std::popcount(words[n]);
    }
    const Chunk* chunk = ground.find(origin);
    EXPECT_EQ(chunk != nullptr ? chunk->loose_count : 0, count);
  }
}

TEST(LooseSoil, IsWhatAPlainModelSaysHotOrCold) {
  std::uint64_t hashes[2];
  for (const bool limited : {false, true}) {
    std::mt19937_64 random(1);
    const test::TempFolder folder;
    Heaps heaps;
    if (limited)
      heaps.ground.set_memory_limit(150'000, std::make_shared<io::SwapFile>(folder.path()));
    int swapped = 0;
    for (int i = 0; i < 1500; ++i) {
      heaps.change(random);
      if (!limited) continue;
      heaps.ground.evict();
      EXPECT_LE(heaps.ground.memory_bytes(), 150'000u);
      for (const Chunk* chunk : heaps.ground.chunks())
        swapped += chunk->swap_record != 0 && chunk->loose_count > 0;
    }
    EXPECT_EQ(swapped > 0, limited);
    expect_loose(heaps.ground, heaps.loose);
    hashes[limited] = heaps.ground.state_hash();
  }
  EXPECT_EQ(hashes[0], hashes[1]);
}

TEST(LooseSoil, ChangesTheStateAndComesAlongInCopies) {
  std::mt19937_64 random(2);
  Heaps heaps;
  for (int i = 0; i < 300; ++i) heaps.change(random);
  Ground copy(kVoxel, Vec3::Zero(), heaps.ground.shared_terrain());
  Ground bank(kVoxel, Vec3::Zero(), heaps.ground.shared_terrain());
  for (const Chunk* chunk : heaps.ground.chunks()) {
    GroundWriter(copy).copy_from(heaps.ground, chunk->origin);
    Chunk plain = heaps.ground.copy(*chunk);
    plain.loose = {};
    GroundWriter(bank).put(std::move(plain));
  }
  expect_loose(copy, heaps.loose);
  EXPECT_EQ(copy.state_hash(), heaps.ground.state_hash());
  EXPECT_NE(bank.state_hash(), heaps.ground.state_hash());
  EXPECT_EQ(bank.change_m3(), heaps.ground.change_m3());
}

TEST(LooseSoil, IsInSnapshots) {
  std::mt19937_64 random(3);
  const test::TempFolder folder;
  const io::Site site = io::site_on(io::PlaneTerrain{100, {0.1, -0.2}});
  GroundWriter writer(*site.ground);
  std::map<Coord3, SampleWords, Before> model;
  for (int x = 0; x < 80; x += 8) {
    const SampleWords set = random_set(random);
    if (x % 16 == 0) {
      writer.add({x, 0, 80}, set, GroundWriter::Kind::kLoose);
      model[{x, 0, 80}] = set;
    } else {
      writer.add({x, 0, 80}, set);
      model[{x, 0, 80}] = {};
    }
  }
  io::write_snapshot(folder / "a.vdb", site, io::kInfo);
  const io::Site back = io::read_snapshot(folder / "a.vdb");
  expect_loose(*back.ground, model);
  EXPECT_EQ(back.ground->state_hash(), site.ground->state_hash());
}

TEST(LooseSoil, IsCountedApartWhenItIsCut) {
  std::mt19937_64 random(4);
  for (const bool body : {false, true}) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    for (int x = -16; x < 16; x += 8)
      for (int y = -16; y < 16; y += 8)
        GroundWriter(ground).add({x, y, 0}, random_set(random), GroundWriter::Kind::kLoose);
    Bucket bucket{0.8, 0.5, {}, {}};
    if (body) bucket.profile = {{0, 0}, {-0.6, -0.1}, {-0.6, 0.6}, {0, 0.5}};
    const auto loose = [&] {
      std::int64_t sum = 0;
      for (const Chunk* chunk : ground.chunks()) sum += chunk->loose_count;
      return sum;
    };
    const auto all = [&] { return std::llround(ground.change_m3() / ground.sample_m3()); };
    const std::int64_t loose_before = loose(), all_before = all();
    std::vector<Pose> path;
    for (int i = 0; i <= 40; ++i)
      path.push_back({{-1 + 0.05 * i, 0.013, 0.2 - 0.005 * i}, from_rpy(0.1, 0.2, 0.3)});
    Excavator excavator(bucket);
    Cut cut = excavator.stamp(ground, path.front());
    const Cut swept = excavator.sweep(ground, path);
    cut.all += swept.all;
    cut.loose += swept.loose;
    EXPECT_GT(cut.loose.captured, 1000);
    EXPECT_EQ(cut.loose.displaced > 0, body);
    EXPECT_GT(cut.all.captured, cut.loose.captured);
    EXPECT_EQ(cut.all.sum(), all_before - all());
    EXPECT_EQ(cut.loose.sum(), loose_before - loose());
  }
}

TEST(LooseSoil, TakesNoMemoryWhereSoilDoesntMove) {
  // The heap's pieces have a head of 8 bytes and come in steps of 16: without the list of what is
  // loose a leaf would take 128, too.
  static_assert(sizeof(SampleLeaf) + 8 <= 128);
  const auto dig = [](Earthmoving earthmoving) {
    auto ground = std::make_unique<Ground>(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(*ground, {{1.2, 0.9, {{0, 0}, {-0.6, 0.3}, {0, 0.9}}, {}}}, earthmoving);
    for (int i = 0; i < 20; ++i) tracker.update(0, Pose{{0.1 * i, 0, -0.3}});
    return ground;
  };
  Earthmoving moves;
  moves.soil = SoilProperties{0.61, 0.25, 1800, {}, {}};
  const auto loose_bytes = [](const Ground& ground) {
    std::size_t bytes = 0;
    for (const Chunk* chunk : ground.chunks()) bytes += chunk->loose.heap_bytes();
    return bytes;
  };
  EXPECT_EQ(loose_bytes(*dig({})), 0u);
  EXPECT_GT(loose_bytes(*dig(moves)), 0u);
}

}  // namespace loose_soil_test
}  // namespace soilvdb::test
