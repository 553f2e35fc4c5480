// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Each follower of a ground sees every change once, whoever else looks.
#include "soilvdb/change_follower.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "core/ground/ground_writer.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::change_follower_test {
namespace {

using Origins = std::set<Coord3, Before>;

constexpr double kVoxel = 0.1;

Ground flat() { return Ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0})); }

/// Changes a chunk at random: it may come, go, or gain and lose samples.
/// @return its origin, and whether anything happened
std::pair<Coord3, bool> change(Ground& ground, std::mt19937_64& random) {
  const auto at = [&] { return 8 * (static_cast<int>(random() % 6) - 3); };
  const Coord3 origin(at(), at(), -8);
  GroundWriter writer(ground);
  const std::size_t chunks = ground.chunk_count();
  if (ground.find(origin) != nullptr && random() % 4 == 0) {
    writer.drop(origin);
    return {origin, true};
  }
  SampleWords samples{};
  samples[random() % 4] = random() & 3;  // few: what is there already is met often
  const bool digs = random() % 2 == 0;
  const std::int64_t changed = digs ? writer.remove(origin, samples) : writer.add(origin, samples);
  return {origin, changed != 0 || ground.chunk_count() != chunks};
}

Origins resident(const Ground& ground) {
  Origins all;
  for (const Chunk* chunk : ground.chunks()) all.insert(chunk->origin);
  return all;
}

/// A follower, and what it must list next.
struct Watched {
  ChangeFollower follower;
  Origins expected;
  void look() {
    const std::vector<Coord3> seen = follower.take();
    EXPECT_TRUE(std::is_sorted(seen.begin(), seen.end(), before));
    const Origins all(seen.begin(), seen.end());
    EXPECT_EQ(all.size(), seen.size()) << "each once";
    EXPECT_TRUE(all == expected);
    expected.clear();
  }
};

TEST(ChangeFollower, AnyNumberSeesEveryChangeOnceWhenever) {
  std::mt19937_64 random(7);
  Ground ground = flat();
  std::vector<std::optional<Watched>> all(5);
  for (int i = 0; i < 3000; ++i) {
    auto& one = all[random() % all.size()];
    const auto what = random() % 20;
    if (!one) {
      one.emplace(Watched{ChangeFollower(ground), resident(ground)});
    } else if (what == 0) {
      one.reset();
    } else if (what < 4) {
      one->look();
    } else {
      const auto [origin, happened] = change(ground, random);
      if (!happened) continue;
      for (auto& other : all)
        if (other) other->expected.insert(origin);
    }
  }
}

TEST(ChangeFollower, ListsAllThatThereIsFirst) {
  std::mt19937_64 random(1);
  Ground ground = flat();
  for (int i = 0; i < 20; ++i) change(ground, random);
  Watched early{ChangeFollower(ground), resident(ground)};
  early.look();
  Watched late{ChangeFollower(ground), resident(ground)};
  late.look();
  EXPECT_TRUE(early.follower.take().empty());
}

TEST(ChangeFollower, FollowsACloneFromWhereTheOtherWas) {
  std::mt19937_64 random(2);
  Ground ground = flat();
  ChangeFollower follower(ground);
  for (int i = 0; i < 20; ++i) change(ground, random);
  follower.take();
  const Coord3 told(800, 0, -8), untold(808, 0, -8), later(816, 0, -8);
  SampleWords some{};
  some[0] = 1;
  GroundWriter(ground).remove(told, some);
  ChangeFollower(ground).take();  // follower is told of it, and has not looked
  GroundWriter(ground).remove(untold, some);
  const std::unique_ptr<Ground> clone = ground.clone();
  ChangeFollower of_clone(*clone, follower);
  GroundWriter(*clone).remove(later, some);
  EXPECT_EQ(of_clone.take(), (std::vector<Coord3>{told, untold, later}));
  EXPECT_EQ(follower.take(), (std::vector<Coord3>{told, untold}));
}

TEST(ChangeFollower, SeesAllOfBothGroundsWhereOneTakesTheOthersPlace) {
  SampleWords some{};
  some[0] = 1;
  Ground ground = flat(), other = flat();
  GroundWriter(ground).remove({0, 0, -8}, some);
  GroundWriter(other).remove({8, 0, -8}, some);
  ChangeFollower follower(ground);
  follower.take();
  GroundWriter(ground).drop({0, 0, -8});
  GroundWriter(ground).remove({16, 0, -8}, some);
  follower.switch_to(other);
  GroundWriter(ground).remove({24, 0, -8}, some);
  GroundWriter(other).remove({32, 0, -8}, some);
  EXPECT_EQ(follower.take(),
            (std::vector<Coord3>{{0, 0, -8}, {8, 0, -8}, {16, 0, -8}, {32, 0, -8}}));
}

TEST(ChangeFollower, MayGoBeforeTheGround) {
  std::mt19937_64 random(3);
  Ground ground = flat();
  ChangeFollower stays(ground);
  { ChangeFollower goes(ground); }
  Coord3 origin;
  for (bool happened = false; !happened;) std::tie(origin, happened) = change(ground, random);
  EXPECT_EQ(stays.take(), std::vector<Coord3>{origin});
}

}  // namespace
}  // namespace soilvdb::change_follower_test
