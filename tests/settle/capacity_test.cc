// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a bucket holds, and where more leaves it, against closed forms and columns of soil under a
// rim of many points.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/capacity_fixture.h"
#include "tests/support/filled_columns.h"

namespace soilvdb::test {
namespace capacity_test {

constexpr double kPi = std::numbers::pi;

TEST(Capacity, IsThatOfColumnsUnderManyPointsOfTheRim) {
  constexpr double kTolerance = 1e-3;  // of what is held, or of a twentieth of the bucket
  constexpr int kCases = 200;
  Random random(1);
  int some = 0, heaped = 0;
  for (int i = 0; i < kCases; ++i) {
    SCOPED_TRACE(i);
    const Bucket bucket = random.bucket();
    const Eigen::Quaterniond attitude = random.machines_attitude();
    const double slope = random(0, 10) < 1 ? 0 : random(0.2, 1.4);
    const Capacity c = capacity(bucket);
    const double held_m3 = c.at(attitude, slope).volume_m3;
    const double unit_m3 = std::max(held_m3, c.struck_m3() / 20);
    const FilledColumns::Sum sum = FilledColumns(bucket, attitude, slope).sum(3e-7 * unit_m3);
    EXPECT_LE(sum.error_m3, kTolerance * unit_m3) << "columns are too few";
    EXPECT_NEAR(held_m3, sum.volume_m3, kTolerance * unit_m3);
    some += held_m3 > c.struck_m3() / 20;
    heaped += held_m3 > c.struck_m3();
  }
  EXPECT_GT(some, kCases / 2);
  EXPECT_GT(heaped, kCases / 10);
}

TEST(Capacity, StruckIsTheBodyAndHeapedTheStandardsRoofUponIt) {
  for (const auto& [long_m, wide_m] : {std::pair(1.5, 1.1), std::pair(1.0, 1.0)}) {
    const double roof_m3 = long_m * wide_m * wide_m / 4 - wide_m * wide_m * wide_m / 12;
    for (const Bucket& bucket : {box(long_m, wide_m, 0.7), box(wide_m, long_m, 0.7)}) {
      const Capacity c = capacity(bucket);
      EXPECT_NEAR(c.struck_m3(), 0.7 * long_m * wide_m, kRounding);
      EXPECT_NEAR(c.heaped_m3(), c.struck_m3() + roof_m3, kRounding);
      const Eigen::Quaterniond level = with_up(Vec3::UnitX());
      EXPECT_NEAR(c.at(level, 1).volume_m3, c.heaped_m3(), kRounding);
      EXPECT_NEAR(c.at(level, 0.5).volume_m3, c.struck_m3() + roof_m3 / 2, kRounding);
      EXPECT_NEAR(c.at(level, 0).volume_m3, c.struck_m3(), kRounding);
    }
  }
  const Capacity round = capacity(round_bucket());
  EXPECT_NEAR(round.struck_m3(), 1.2 * 0.82355, kRounding);
  EXPECT_NEAR(round.heaped_m3() - round.struck_m3(), 1.2 * 1.15 * 1.15 / 4 - std::pow(1.15, 3) / 12,
              kRounding);
}

TEST(Capacity, OfWaterInATippedBoxIsAPrism) {
  const double width = 1.3, height = 0.9, depth = 0.7;
  const Capacity c = capacity(box(width, height, depth));
  for (const double angle : {0.05, 0.3, 0.6, 0.9, 1.2, 1.5}) {
    const auto prism_m3 = [&](double side, double along) {
      const double drop = side * std::tan(angle);
      return along *
             (drop < depth ? side * (depth - drop / 2) : depth * depth / 2 / std::tan(angle));
    };
    const double x = std::cos(angle), s = std::sin(angle);
    for (const double sign : {-1.0, 1.0}) {
      EXPECT_NEAR(c.at(with_up({x, 0, sign * s}), 0).volume_m3, prism_m3(height, width), kRounding);
      EXPECT_NEAR(c.at(with_up({x, sign * s, 0}), 0).volume_m3, prism_m3(width, height),
                  kQuadrature * c.struck_m3());
    }
  }
  // Over a corner: less by the wedge above it.
  const Vec3 up = Vec3(1, 0.3, 0.2).normalized();
  EXPECT_NEAR(c.at(with_up(up), 0).volume_m3,
              width * height * (depth - (0.3 * width + 0.2 * height) / 2),
              kQuadrature * c.struck_m3());
}

TEST(Capacity, OverTheLipAloneIsThatOfWaterInABucketCurledFurtherByRepose) {
  const Capacity c = capacity(round_bucket());
  for (const double repose : {0.2, 0.61, 0.9}) {
    for (double pitch = 0; pitch > repose - kPi / 2; pitch -= 0.1) {
      EXPECT_NEAR(c.at(pitched(pitch), std::tan(repose)).volume_m3,
                  c.at(pitched(pitch - repose), 0).volume_m3, kRounding);
    }
  }
}

TEST(Capacity, IsNothingWithTheMouthDown) {
  for (const double slope : {0.0, 0.3, 0.7, 1.0}) {
    for (const Bucket& bucket : {round_bucket(), box(1, 0.8, 0.6), box(0.8, 1, 1.6)}) {
      const Capacity c = capacity(bucket);
      EXPECT_EQ(c.at(with_up(-Vec3::UnitX()), slope).volume_m3, 0);
      EXPECT_EQ(c.at(with_up(Vec3(-1, 0.1, 0.2).normalized()), slope).volume_m3, 0);
      EXPECT_EQ(c.at(from_rpy(0.3, 0.9, 2), slope).volume_m3, 0);
    }
  }
}

TEST(Capacity, WithTheMouthDownIsWhatLiesBesideTheMouth) {
  // A shelf 0.2 above the mouth's plane and 0.5 wide; the rest of the body is above the mouth.
  const std::vector<Vec2> shelf = {{0, 0},       {-0.2, 0}, {-0.2, -0.5},
                                   {-0.8, -0.5}, {-0.8, 1}, {0, 1}};
  std::vector<Vec2> swapped;
  for (auto p = shelf.rbegin(); p != shelf.rend(); ++p) swapped.emplace_back(p->x(), 1 - p->y());
  for (const auto& profile : {shelf, swapped}) {
    const Bucket bucket{1.5, 1, profile, {}};
    bucket.validate();
    const Capacity c = capacity(bucket);
    for (const double slope : {0.3, 0.5, 1.0, 1.5}) {
      const double high_m = std::max(0.0, 0.5 * slope - 0.2);
      EXPECT_NEAR(c.at(with_up(-Vec3::UnitX()), slope).volume_m3, 1.5 * high_m * high_m / 2 / slope,
                  kRounding);
    }
  }
}

TEST(Capacity, IsUnlimitedWithoutAProfile) { EXPECT_FALSE(Capacity::of({1.2, 0.9, {}, {}})); }

TEST(CapacitySpill, IsTheMiddleOfTheLowerEdgeOfALevelBucket) {
  const Capacity c = capacity(round_bucket());
  for (const double pitch : {-0.9, -0.4, 0.0, 0.6}) {
    EXPECT_LT(c.at(pitched(pitch), 0.7).spill.norm(), kRounding) << pitch;
  }
  for (const double pitch : {-2.3, -2.8, -3.14}) {
    EXPECT_LT((c.at(pitched(pitch), 0.7).spill - Vec3(0, 0, 1.15)).norm(), kRounding) << pitch;
  }
}

TEST(CapacitySpill, IsTheLowerCornerOfOneBankedBeyondRepose) {
  const Capacity c = capacity(round_bucket());
  EXPECT_LT((c.at(from_rpy(0.7, -0.2, 0), 0.7).spill - Vec3(0, -0.6, 0)).norm(), kRounding);
  EXPECT_LT((c.at(from_rpy(-0.7, -0.2, 0), 0.7).spill - Vec3(0, 0.6, 0)).norm(), kRounding);
}

TEST(CapacitySpill, FallsStraightOutOfAMouthThatLooksDown) {
  const Vec3 spill = capacity(box(1, 0.8, 0.6)).at(with_up(-Vec3::UnitX()), 0.7).spill;
  EXPECT_LT((spill - Vec3(0, 0, 0.4)).norm(), kRounding);
}

TEST(CapacitySpill, IsAlongAllOfALevelEdgeAndAtTheEndOfOneThatIsBanked) {
  const Capacity c = capacity(round_bucket());
  const double half = 0.6, level_m = 0.05;
  const auto length = [&](double roll) {
    const auto line = c.spill_line(from_rpy(roll, 0, 0), 0.7, level_m);
    EXPECT_EQ(line[0].x(), 0);
    EXPECT_EQ(line[0].z(), 0);
    return (line[1] - line[0]).norm();
  };
  EXPECT_NEAR(length(0), 2 * half, kRounding);
  EXPECT_NEAR(length(0.02), 2 * half, kRounding) << "within a voxel";
  for (const double roll : {0.1, 0.3}) {
    EXPECT_NEAR(length(roll), level_m / std::sin(roll), kRounding);
    EXPECT_NEAR(c.spill_line(from_rpy(roll, 0, 0), 0.7, level_m)[0].y(), -half, kRounding);
    EXPECT_NEAR(c.spill_line(from_rpy(-roll, 0, 0), 0.7, level_m)[1].y(), half, kRounding);
  }
}

TEST(Capacity, GrowsToTheStruckVolumeAsGroundHoldsTheSoilIn) {
  // Below the ground before it a box is full, above it soil is as steep as repose.
  const double height_m = 0.8, depth_m = 0.6, slope = 0.7;
  const Capacity c = capacity(box(1, height_m, depth_m));
  for (const double held_m : {0.0, 0.1, 0.25, 0.37}) {
    const double high_m = std::min(height_m - held_m, slope * depth_m);
    const double wedge_m2 = high_m * high_m / 2 / slope + (depth_m - high_m / slope) * high_m;
    EXPECT_NEAR(c.at(pitched(0), slope, held_m).volume_m3, held_m * depth_m + wedge_m2, 1e-4)
        << held_m;
  }
  for (const double pitch : {-0.5, 0.0, 0.4}) {
    double last = 0;
    for (double held_m = 0; held_m < 1.2 * height_m; held_m += 0.05) {
      const double holds = c.at(pitched(pitch), slope, held_m).volume_m3;
      EXPECT_GE(holds, last - 1e-9) << pitch << ' ' << held_m;
      EXPECT_LE(holds, c.struck_m3() + 1e-9);
      last = holds;
    }
  }
}

}  // namespace capacity_test
}  // namespace soilvdb::test
