// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Columns that rise and fall by so many samples, against a sort of all that are there.
#include "core/settle/column_samples.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <random>
#include <set>
#include <tuple>
#include <utility>

#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::test {
namespace column_samples_test {

constexpr double kVoxel = 0.1, kSlope = 0.7;
/// Heights are floats of some hundred cells at most.
constexpr double kRounding = 1e-4;

using Sets = std::map<Coord3, SampleWords, Before>;

/// What the grounds here hold, by chunk.
Sets sets_of(const Ground& ground, bool loose) {
  Sets sets;
  for (int x = -24; x < 24; x += 8) {
    for (int y = -24; y < 24; y += 8) {
      for (int z = -48; z < 80; z += 8) {
        if (loose) {
          ground.read_loose({x, y, z}, sets[{x, y, z}]);
        } else {
          ground.read_samples({x, y, z}, sets[{x, y, z}]);
        }
      }
    }
  }
  return sets;
}

bool has(const Sets& sets, const Coord3& cell, std::size_t point) {
  return sets.at(floor_to(cell, kChunkSide))[static_cast<std::size_t>(cell_number(cell))] >> point &
         1;
}

struct Sample {
  Coord3 cell;
  std::size_t point;
  double above;  ///< a surface of the column's shape, cells
};

std::vector<Sample> samples_of(const ColumnEdit& s) {
  std::vector<Sample> all;
  for (int z = s.low; z <= s.high; ++z) {
    const Coord3 cell(s.cell.x(), s.cell.y(), z);
    const CellPoints& points = sample_points(cell);
    for (std::size_t i = 0; i < 64; ++i) {
      const double x = points.x[i], y = points.y[i], up = z - s.low + double{points.z[i]};
      const double surface =
          s.cone ? -kSlope * std::hypot(x - s.a, y - s.b) : s.a * (x - 0.5) + s.b * (y - 0.5);
      all.push_back({cell, i, up - surface});
    }
  }
  return all;
}

std::int64_t count(const Sets& sets) {
  std::int64_t sum = 0;
  for (const auto& [origin, words] : sets)
    for (const std::uint64_t word : words) sum += std::popcount(word);
  return sum;
}

/// Ground with partly full cells, loose soil among them.
void rough(Ground& ground, std::mt19937_64& random) {
  for (int i = 0; i < 60; ++i) {
    const auto at = [&](int low) { return low + static_cast<int>(random() % 6) * 8; };
    const Coord3 origin(at(-24), at(-24), at(-16));
    SampleWords set;
    for (std::uint64_t& word : set) {
      const std::uint64_t r = random() % 4;
      word = r == 0 ? kAllSoil : r == 1 ? random() : r == 2 ? random() & random() : 0;
    }
    const std::uint64_t kind = random() % 3;
    if (kind == 0) GroundWriter(ground).remove(origin, set);
    if (kind == 1) GroundWriter(ground).add(origin, set);
    if (kind == 2) GroundWriter(ground).add(origin, set, GroundWriter::Kind::kLoose);
  }
}

/// @param most samples of a column: some columns are asked for none, or more than they have room
std::vector<ColumnEdit> random_changes(std::mt19937_64& random, int most) {
  std::uniform_real_distribution<float> unit(0, 1);
  std::vector<ColumnEdit> changes;
  const bool cone = random() % 2 == 0;
  const float ax = 20 * unit(random) - 10, ay = 20 * unit(random) - 10;
  const float a = 2 * unit(random) - 1, b = 2 * unit(random) - 1;
  for (int x = -20; x < 20; ++x) {
    for (int y = -20; y < 20; ++y) {
      if (random() % 5 == 0) continue;
      const int low = -5 - static_cast<int>(random() % 8);
      const int high = low + 5 + static_cast<int>(random() % 30);
      const auto samples = static_cast<std::int64_t>(random() % static_cast<std::uint64_t>(most));
      const auto wanted = random() % 8 == 0 ? 0 : samples;
      changes.push_back({.cell = {x, y},
                         .low = low,
                         .high = high,
                         .samples = wanted,
                         .cone = cone,
                         .a = cone ? ax - static_cast<float>(x) : a,
                         .b = cone ? ay - static_cast<float>(y) : b});
    }
  }
  return changes;
}

struct RoughGround {
  Ground ground{kVoxel, Vec3::Zero(), make_plane(0.02, {0.1, -0.2})};
  Sets before, loose_before;
  explicit RoughGround(std::uint64_t seed) {
    std::mt19937_64 random(seed);
    rough(ground, random);
    before = sets_of(ground, false);
    loose_before = sets_of(ground, true);
  }
};

TEST(ColumnSamples, AddsExactlySoManyToEachColumnAndTheLowest) {
  std::mt19937_64 random(1);
  int more_than_room = 0, whole = 0;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    RoughGround rough(seed);
    const auto changes = random_changes(random, seed % 3 == 0 ? 3000 : 400);
    const std::int64_t added = add_samples(rough.ground, changes, kSlope);
    const Sets after = sets_of(rough.ground, false), loose = sets_of(rough.ground, true);
    std::int64_t sum = 0;
    for (const ColumnEdit& change : changes) {
      std::int64_t room = 0, found = 0;
      double highest = -1e9, lowest_left = 1e9;
      for (const Sample& s : samples_of(change)) {
        if (has(rough.before, s.cell, s.point)) continue;
        ++room;
        if (has(after, s.cell, s.point)) {
          ++found;
          EXPECT_TRUE(has(loose, s.cell, s.point));
          highest = std::max(highest, s.above);
        } else {
          lowest_left = std::min(lowest_left, s.above);
        }
      }
      EXPECT_EQ(found, std::min(room, change.samples));
      EXPECT_LE(highest, lowest_left + kRounding);
      ++(change.samples > room ? more_than_room : whole);
      sum += found;
    }
    EXPECT_EQ(added, sum);
    EXPECT_EQ(count(after) - count(rough.before), sum);
    EXPECT_EQ(count(loose) - count(rough.loose_before), sum);
  }
  EXPECT_GT(more_than_room, 500);
  EXPECT_GT(whole, 500);
}

TEST(ColumnSamples, RemovesExactlySoManyFromEachColumnAndTheHighest) {
  std::mt19937_64 random(4);
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    const bool bank = seed % 2 == 0;
    RoughGround rough(seed);
    const auto changes = random_changes(random, seed % 3 == 0 ? 2000 : 300);
    Taken taken;
    std::vector<std::int64_t> by_column;
    if (bank)
      taken = remove_top(rough.ground, changes, kSlope);
    else
      by_column = remove_loose(rough.ground, changes, kSlope);
    for (const std::int64_t samples : by_column) taken.loose += samples;
    const Sets after = sets_of(rough.ground, false), loose = sets_of(rough.ground, true);
    Taken expected;
    for (const ColumnEdit& change : changes) {
      std::int64_t there = 0, gone = 0;
      double lowest = 1e9, highest_left = -1e9;
      for (const Sample& s : samples_of(change)) {
        const bool was_loose = has(rough.loose_before, s.cell, s.point);
        if (!has(rough.before, s.cell, s.point) || !(bank || was_loose)) continue;
        ++there;
        if (has(after, s.cell, s.point)) {
          highest_left = std::max(highest_left, s.above);
        } else {
          ++gone;
          ++(was_loose ? expected.loose : expected.bank);
          lowest = std::min(lowest, s.above);
        }
      }
      EXPECT_EQ(gone, std::min(there, change.samples));
      if (!bank) {
        EXPECT_EQ(by_column[static_cast<std::size_t>(&change - changes.data())], gone);
      }
      EXPECT_GE(lowest, highest_left - kRounding);
    }
    EXPECT_EQ(taken.bank, expected.bank);
    EXPECT_EQ(taken.loose, expected.loose);
    EXPECT_GT(taken.loose, 1000);
    EXPECT_EQ(taken.bank > 0, bank);
    EXPECT_EQ(count(rough.before) - count(after), taken.bank + taken.loose);
    EXPECT_EQ(count(rough.loose_before) - count(loose), taken.loose);
  }
}

TEST(ColumnSamples, AreTheSameInAnyOrderAndOnAnyNumberOfThreads) {
  std::mt19937_64 random(3);
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    auto changes = random_changes(random, 600), fewer = random_changes(random, 300);
    std::uint64_t hash = 0;
    for (const std::size_t threads : {1u, 2u, 4u}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      for (int run = 0; run < 2; ++run) {
        RoughGround rough(seed);
        add_samples(rough.ground, changes, kSlope);
        remove_top(rough.ground, fewer, kSlope);
        if (hash == 0) hash = rough.ground.state_hash();
        EXPECT_EQ(rough.ground.state_hash(), hash);
        std::shuffle(changes.begin(), changes.end(), random);
        std::shuffle(fewer.begin(), fewer.end(), random);
      }
    }
  }
}

TEST(ColumnSamples, ChangeInOnePassAsInOneForColumnsThatFallAndOneForThoseThatRise) {
  std::mt19937_64 random(5);
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    const bool loose = seed % 2 == 0;
    RoughGround rough(seed), other(seed);
    std::vector<ColumnEdit> changes = random_changes(random, 400), falling, rising;
    for (ColumnEdit& change : changes) {
      if (change.cone) change = {change.cell, change.low, change.high, change.samples};
      change.rises = random() % 2 == 0;
      (change.rises ? rising : falling).push_back(change);
    }
    std::map<std::pair<int, int>, std::pair<int, int>> counts;  // bank and loose, by column
    std::set<std::tuple<int, int, int>> chunks;
    const ChangedSamples changed = change_samples(
        rough.ground, changes, loose, [&](const Coord3& chunk, const ColumnCounts& of_chunk) {
          EXPECT_TRUE(chunks.emplace(chunk.x(), chunk.y(), chunk.z()).second);
          for (int c = 0; c < kChunkSide * kChunkSide; ++c) {
            auto& [bank, moved] = counts[{chunk.x() + c / kChunkSide, chunk.y() + c % kChunkSide}];
            bank += of_chunk.bank[static_cast<std::size_t>(c)];
            moved += of_chunk.loose[static_cast<std::size_t>(c)];
          }
        });
    const Taken taken = remove_top(other.ground, falling, 0);
    const std::int64_t added = add_samples(other.ground, rising, 0);
    EXPECT_EQ(changed.taken.bank, taken.bank);
    EXPECT_EQ(changed.taken.loose, taken.loose);
    EXPECT_EQ(changed.added, added);
    EXPECT_GT(std::min({taken.bank, taken.loose, added}), 1000);
    const Sets after = sets_of(rough.ground, false), moved = sets_of(rough.ground, true);
    EXPECT_EQ(after, sets_of(other.ground, false));
    if (loose) {
      EXPECT_EQ(rough.ground.state_hash(), other.ground.state_hash());
    }
    std::map<std::pair<int, int>, std::pair<int, int>> expected;
    for (const auto& [origin, words] : after) {
      for (std::size_t n = 0; n < words.size(); ++n) {
        const Coord3 cell = origin + numbered_voxel(static_cast<int>(n));
        auto& [bank, of_moved] = expected[{cell.x(), cell.y()}];
        const int more_loose =
            std::popcount(moved.at(origin)[n]) - std::popcount(rough.loose_before.at(origin)[n]);
        of_moved += more_loose;
        bank += std::popcount(words[n]) - std::popcount(rough.before.at(origin)[n]) - more_loose;
      }
    }
    for (const auto& [column, count] : expected) EXPECT_EQ(counts[column], count);
  }
}

TEST(ColumnSamples, OfNoCellsStay) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  // The highest cell that may change is below the lowest, by some chunks.
  EXPECT_EQ(
      add_samples(ground, {{{.cell = {1, 2}, .low = 5, .high = -40, .samples = 100}}}, kSlope), 0);
  EXPECT_EQ(
      remove_loose(ground, {{{.cell = {1, 2}, .low = 5, .high = -40, .samples = 100}}}, kSlope),
      std::vector<std::int64_t>{0});
  EXPECT_TRUE(ground.chunks().empty());
}

TEST(ColumnSamples, OfOneCellAreAddedAndRemoved) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  const std::vector<ColumnEdit> one{{.cell = {1, 2}, .low = 5, .high = 5, .samples = 40}};
  EXPECT_EQ(add_samples(ground, one, kSlope), 40);
  EXPECT_EQ(remove_loose(ground, one, kSlope), std::vector<std::int64_t>{40});
}

TEST(ColumnSamples, StayWithoutChanges) {
  RoughGround rough(1);
  const std::uint64_t hash = rough.ground.state_hash();
  EXPECT_EQ(add_samples(rough.ground, {}, kSlope), 0);
  EXPECT_EQ(remove_top(rough.ground, {}, kSlope).bank, 0);
  EXPECT_EQ(rough.ground.state_hash(), hash);
}

}  // namespace column_samples_test
}  // namespace soilvdb::test
