// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A sweep takes each sample that a face passes through, and no other: against all samples asked one
// by one, where the quick ways past most of them are at their limits.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <random>

#include "core/constants.h"
#include "soilvdb/motion.h"
#include "tests/support/swept_samples.h"

namespace soilvdb::test {
namespace sweep_test {

constexpr double kVoxel = 0.125;  // a binary fraction

std::int64_t count(const SampleSet& set) {
  std::int64_t sum = 0;
  for (const auto& [origin, words] : set) {
    for (const std::uint64_t word : words) sum += std::popcount(word);
  }
  return sum;
}

SampleWords words_of(const SampleSet& set, const Coord3& origin) {
  const auto at = set.find(origin);
  return at == set.end() ? SampleWords{} : at->second;
}

struct Wrong {
  std::int64_t missed = 0, invented = 0;
};

Wrong wrong(const SampleSet& removed, const Swept& swept) {
  Wrong sum;
  const auto compare = [&](const Coord3& origin) {
    const SampleWords is = words_of(removed, origin), must = words_of(swept.surely, origin),
                      may = words_of(swept.perhaps, origin);
    for (std::size_t n = 0; n < is.size(); ++n) {
      sum.missed += std::popcount(must[n] & ~is[n]);
      sum.invented += std::popcount(is[n] & ~must[n] & ~may[n]);
    }
  };
  for (const auto& [origin, words] : swept.surely) compare(origin);
  for (const auto& [origin, words] : removed) {
    if (!swept.surely.contains(origin)) compare(origin);
  }
  return sum;
}

/// Digs a path, and asks each sample.
void expect_as_asked(const Bucket& bucket, std::span<const Pose> path) {
  Block block(bucket, kVoxel);
  block.sweep(path);
  const SampleSet removed = block.removed();
  const Swept swept = sweep_by_sample(bucket, kVoxel, path);
  const Wrong found = wrong(removed, swept);
  EXPECT_EQ(found.missed, 0) << "of " << count(swept.surely);
  EXPECT_EQ(found.invented, 0) << "of " << count(swept.surely);
  EXPECT_EQ(block.cut.all.sum(), count(removed));
  EXPECT_LT(count(swept.perhaps), count(swept.surely) / 100 + 50) << "too few are asked";
}

double between(std::mt19937& random, double low, double high) {
  return std::uniform_real_distribution(low, high)(random);
}
Vec3 in_cube(std::mt19937& random, double side) {
  const double x = between(random, -side / 2, side / 2), y = between(random, -side / 2, side / 2);
  return {x, y, between(random, -side / 2, side / 2)};
}
Eigen::Quaterniond any_turn(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const double w = normal(random), x = normal(random), y = normal(random);
  return Eigen::Quaterniond(w, x, y, normal(random)).normalized();
}
/// One of the 24 that take the lattice's axes to its axes.
Eigen::Quaterniond quarter_turns(std::mt19937& random) {
  const auto quarters = [&] { return static_cast<int>(random() % 4) * std::acos(0.0); };
  const double roll = quarters(), pitch = quarters();
  return from_rpy(roll, pitch, quarters());
}

Bucket bucket_of(double width_voxels, double height_voxels, bool body) {
  Bucket bucket{kVoxel * width_voxels, kVoxel * height_voxels, {}, {}};
  const double z = bucket.height_m, x = 5 * kVoxel;
  if (body) bucket.profile = {{0, 0}, {-0.8 * x, -0.1 * z}, {-x, 0.6 * z}, {-0.5 * x, z}, {0, z}};
  return bucket;
}

TEST(Sweep, OfARolledBucketTakesWhatItsFacesPass) {
  std::mt19937 random(1);
  for (int i = 0; i < 24; ++i) {
    SCOPED_TRACE(i);
    const Bucket bucket = bucket_of(between(random, 4, 14), between(random, 4, 12), i % 3 == 0);
    const Pose from{kVoxel * in_cube(random, 20), any_turn(random)};
    const Eigen::AngleAxisd turn(between(random, 0, 0.4), in_cube(random, 1).normalized());
    const Pose to{from.position + kVoxel * in_cube(random, 12), turn * from.rotation};
    std::vector<Pose> path{from};
    trace(from, to, bucket, kMaxBend * kVoxel, kPathStride * kVoxel, path);
    expect_as_asked(bucket, path);
  }
}

/// Edges of the mouth within a bend of chunks' borders, ways that bend as much as they may.
TEST(Sweep, WithEdgesOnBordersOfChunksTakesWhatBendsInAndLeavesWhatBendsOut) {
  std::mt19937 random(2);
  for (int i = 0; i < 120; ++i) {
    SCOPED_TRACE(i);
    const auto near_zero = [&] { return between(random, -kMaxBend, kMaxBend); };
    const Bucket bucket = bucket_of(8 + near_zero(), 8 + near_zero(), i % 10 == 9);
    const Eigen::Quaterniond turn = quarter_turns(random);
    // The middle of the mouth is that of a chunk's face, but for a bend.
    const Vec3 lip(between(random, -4, 4), near_zero(), near_zero() - 4);
    const Vec3 way(i % 3 == 0 ? -6 : 6, i % 4 == 0 ? between(random, -2, 2) : near_zero(),
                   i % 4 == 1 ? between(random, -2, 2) : near_zero());
    Vec3 bend = in_cube(random, 1).normalized();
    if (i % 2 == 0) bend = Vec3::Unit(static_cast<int>(random() % 3)) * (i % 4 == 0 ? 1 : -1);
    const Vec3 middle = Vec3::Constant(3.5);
    const auto pose = [&](const Vec3& at) { return Pose{kVoxel * (middle + turn * at), turn}; };
    const std::vector<Pose> path{pose(lip), pose(lip + way / 2 + 0.999 * kMaxBend * bend),
                                 pose(lip + way)};
    expect_as_asked(bucket, path);
  }
}

/// A plane on which samples lie, whose coordinates and differences are exact in floats.
struct SplitDrag {
  Bucket bucket{kVoxel * 40, kVoxel * 40, {}, {}};
  Pose at(double x_voxels) const {
    return {{kVoxel * x_voxels, 0, -20 * kVoxel}, Eigen::Quaterniond::Identity()};
  }
  std::vector<Pose> path(const std::vector<double>& stops) const {
    std::vector<Pose> poses{at(stops.front())};
    for (std::size_t i = 1; i < stops.size(); ++i) {
      poses.push_back(at((stops[i - 1] + stops[i]) / 2));
      poses.push_back(at(stops[i]));
    }
    return poses;
  }
};

TEST(Sweep, ThatStopsOnSamplesAndGoesOnTakesEachOnceBothWays) {
  constexpr double kOn = 3 - 0.5 + 21.0 / 128;  // a sample of each cell of pattern 0 of a layer
  SplitDrag drag;
  int on_plane = 0;
  for (int y = -19; y < 20; ++y) {
    for (int z = -19; z < 20; ++z) {
      const CellPoints& points = sample_points({3, y, z});
      on_plane += std::count(points.x, points.x + 64, static_cast<float>(kOn - 2.5)) > 0;
    }
  }
  ASSERT_GT(on_plane, 5);
  for (const bool body : {false, true}) {
    if (body) drag.bucket.profile = {{0, 0}, {-kVoxel * 12, kVoxel * 20}, {0, kVoxel * 40}};
    for (const double way : {2.0, -2.0, 0.5, -0.5}) {
      SCOPED_TRACE(::testing::Message() << body << " " << way);
      Block whole(drag.bucket, kVoxel), split(drag.bucket, kVoxel), calls(drag.bucket, kVoxel);
      whole.sweep(drag.path({kOn - way, kOn + way}));
      split.sweep(drag.path({kOn - way, kOn, kOn + way}));
      calls.sweep(drag.path({kOn - way, kOn}));
      calls.sweep(drag.path({kOn, kOn + way}));
      const SampleSet removed = whole.removed();
      for (const Block* parts : {&split, &calls}) {
        EXPECT_TRUE(parts->removed() == removed)
            << count(parts->removed()) << " instead of " << count(removed);
        EXPECT_EQ(parts->cut.all.captured, whole.cut.all.captured);
        EXPECT_EQ(parts->cut.all.displaced, whole.cut.all.displaced);
        EXPECT_EQ(parts->cut.all.sum(), count(removed));
      }
    }
  }
}

}  // namespace sweep_test
}  // namespace soilvdb::test
