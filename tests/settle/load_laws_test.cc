// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a bucket holds whenever somebody looks: never more than it can at its attitude, however far
// it turned since the update before.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "tests/support/capacity_fixture.h"
#include "tests/support/earthmoving_fixture.h"
#include "tests/support/filled_columns.h"

namespace soilvdb::test {
namespace load_laws_test {

/// A plane that rises along x, and one bucket.
struct Site {
  Bucket bucket;
  Ground ground;
  Tracker tracker;
  Site(double voxel_m, Bucket b, double slope = 0)
      : bucket(std::move(b)),
        ground(voxel_m, Vec3::Zero(), make_plane(0, {slope, 0})),
        tracker(ground, {bucket}, loam()) {}
  double load_m3() const { return tracker.ledger(0).bucket_m3(); }
  /// What can stay in it, by columns of soil.
  FilledColumns::Sum most(const Eigen::Quaterniond& rotation) const {
    return FilledColumns(bucket, rotation, kSlope).sum(1e-6 * capacity(bucket).struck_m3());
  }
  /// Out of the ground: in it what is before the mouth holds the load in.
  bool holds_too_much(const Pose& at) const {
    if (at.position.z() < 2) return false;
    const FilledColumns::Sum sum = most(at.rotation);
    return load_m3() > sum.volume_m3 + sum.error_m3 + ground.sample_m3();
  }
  /// Dragged through the ground, curled so that most stays in it, and lifted out.
  void fill() {
    for (const Pose& pose : {Pose{{0, 0, -1.2}, pitched(-0.3)}, Pose{{3, 0, -1.2}, pitched(-0.3)},
                             Pose{{3.2, 0, -1}, pitched(-1.3)}, Pose{{3.2, 0, 3}, pitched(-1.3)}})
      tracker.update(0, pose);
  }
};

/// A box 1 m wide, 0.6 m high and 0.8 m deep.
constexpr double kDepth = 0.8;
Bucket crate() { return box(1, 0.6, kDepth); }
/// What stays on its floor when that goes down towards the lip: a wedge as steep as repose.
double wedge_m3(double pitch) { return kDepth * kDepth / 2 * std::tan(kRepose - pitch); }

TEST(Load, OfABucketThatWasTippedIsWhatStaysOnItsFloor) {
  for (const double pitch : {0.05, 0.2, 0.4, 0.55}) {
    for (const int updates : {1, 3, 20}) {
      SCOPED_TRACE(::testing::Message() << pitch << " rad in " << updates);
      Site site(0.1, crate());
      site.fill();
      Update update;
      Pose last{{3.2, 0, 3}, {}};
      for (int i = 1; i <= updates; ++i) {
        last.rotation = pitched(-1.3 + (pitch + 1.3) * i / updates);
        update = site.tracker.update(0, last);
      }
      EXPECT_NEAR(update.bucket_m3, wedge_m3(pitch), site.ground.sample_m3());
      EXPECT_EQ(residual(site.tracker), 0);
      const double before = site.load_m3();
      site.tracker.update(0, last);
      EXPECT_EQ(site.load_m3(), before) << "again the same state";
      EXPECT_LT(site.tracker.mass_balance().pending, site.tracker.mass_balance().units.loose);
      site.tracker.come_to_rest();
      EXPECT_EQ(site.load_m3(), before) << "at rest";
    }
  }
}

// What it digs from one station to the next it holds no more than what it held at a station.
TEST(Load, OfAFullBucketInTheGroundDoesNotSwingFromUpdateToUpdate) {
  Random random(41);
  for (const double voxel_m : {0.1, 0.05}) {
    for (int n = 0; n < 3; ++n) {
      SCOPED_TRACE(::testing::Message() << voxel_m << " m, " << n);
      Site site(voxel_m, digger());
      const double struck_m3 = capacity(site.bucket).struck_m3();
      const double depth_m = random(0.2, 0.4), pitch = random(-0.1, 0.2);
      const auto at = [&](double x) { return Pose{{x, 0, -depth_m}, pitched(pitch)}; };
      site.tracker.update(0, Pose{{-6, 0, 0.5}, pitched(pitch)});
      for (double x = -5.6; x < 0; x += 0.05) site.tracker.update(0, at(x));  // it is full then
      double before_m3 = site.load_m3();
      for (double x = 0; x < 2;) {
        x += random(0.005, 0.03);
        const Update update = site.tracker.update(0, at(x));
        EXPECT_LE(std::abs(update.bucket_m3 - before_m3), 0.03 * struck_m3) << x;
        EXPECT_EQ(residual(site.tracker), 0);
        before_m3 = update.bucket_m3;
      }
      EXPECT_GT(before_m3, 0.5 * struck_m3);
    }
  }
}

// A heap before the mouth that is made at once holds too much in, and then too little. A mouth that
// looks down leans over the place where the heap should be.
TEST(Load, OfFullBucketsThatAreDraggedSwingsLittleBetweenStations) {
  Random random(43);
  double sum = 0;
  constexpr int kBuckets = 12;
  for (int n = 0; n < kBuckets; ++n) {
    Bucket bucket = digger();
    bucket.width_m = random(0.5, 2);
    const double slope = random(-0.15, 0.15);
    const double voxel_m = n % 3 == 0 ? 0.1 : 0.05;
    Site site(voxel_m, bucket, slope);
    const double struck_m3 = capacity(bucket).struck_m3();
    const double depth_m = random(0.2, 0.45), pitch = random(0.1, 0.6);
    const auto at = [&](double x, double up_m = 0) {
      return Pose{{x, 0, slope * x - depth_m + up_m}, pitched(pitch - std::atan(slope))};
    };
    site.tracker.update(0, at(-6, 1));
    for (double x = -5.6; x < 0; x += 0.02) site.tracker.update(0, at(x));  // it is full then
    std::vector<double> loads_m3;
    for (int i = 1; i <= 150; ++i)
      loads_m3.push_back(site.tracker.update(0, at(0.01 * i)).bucket_m3);
    double swing = 0;
    for (std::size_t i = 0; i + 12 < loads_m3.size(); ++i) {
      const auto [least, most] = std::minmax_element(loads_m3.begin() + static_cast<long>(i),
                                                     loads_m3.begin() + static_cast<long>(i + 12));
      swing = std::max(swing, (*most - *least) / struck_m3);
    }
    EXPECT_LT(swing, 0.03) << voxel_m << " m, down by " << pitch << ", rise " << slope;
    sum += swing;
    EXPECT_GT(loads_m3.back(), 0.5 * struck_m3);
    EXPECT_EQ(residual(site.tracker), 0);
  }
  EXPECT_LT(sum / kBuckets, 0.01);
}

TEST(Load, IsHeldInByTheGroundBeforeTheMouthAsHighAsThatIs) {
  double before_m3 = 0;
  for (const double depth_m : {0.1, 0.2, 0.35}) {
    Site site(0.05, digger());
    for (double x = -8; x < 0; x += 0.05)
      site.tracker.update(0, Pose{{x, 0, -depth_m}, pitched(0.2)});
    EXPECT_GT(site.load_m3(), 1.05 * before_m3) << depth_m;
    before_m3 = site.load_m3();
    if (depth_m < 0.3) {
      EXPECT_LT(before_m3, 0.9 * capacity(site.bucket).struck_m3()) << depth_m;
    }
  }
}

TEST(Load, IsNeverMoreThanTheBucketHoldsWhereverItTurns) {
  Random random(31);
  int full = 0;
  for (int n = 0; n < 4; ++n) {
    const Bucket bucket = random.bucket();
    Site site(random(0.1, 0.2), bucket);
    site.fill();
    Pose at{{3.2, 0, 3}, pitched(-1.3)};
    for (int i = 0; i < 30; ++i) {
      SCOPED_TRACE(::testing::Message() << n << ", " << i);
      const double before = site.load_m3();
      const double kind = random(0, 4);
      if (kind < 1) at.rotation = random.machines_attitude();
      if (kind < 3) at.rotation = at.rotation * from_rpy(random(-0.1, 0.1), random(-0.1, 0.1), 0);
      at.position = {random(0, 3), random(-1, 1), random(0, 3) < 1 ? random(-0.8, 0) : 3};
      if (i % 13 == 12) site.fill();
      const Update update = site.tracker.update(0, at);
      ASSERT_EQ(update.bucket_m3, site.load_m3());
      ASSERT_FALSE(site.holds_too_much(at));
      if (update.cut_m3 == 0 && i % 13 != 12) {
        ASSERT_LE(update.bucket_m3, before);
      }
      ASSERT_EQ(residual(site.tracker), 0);
      const double most_m3 = site.most(at.rotation).volume_m3;
      full += most_m3 > 0.01 && update.bucket_m3 > 0.99 * most_m3;
      if (i % 7 == 6) {
        const double load = site.load_m3();
        site.tracker.come_to_rest();
        if (at.position.z() > 2) {
          ASSERT_EQ(site.load_m3(), load);
        }
        ASSERT_LE(site.load_m3(), load);
      }
    }
  }
  EXPECT_GT(full, 15) << "of buckets that can't hold more";
}

/// A bucket that is filled, lifted and tipped and rolled to and fro, as rows this far apart have
/// it.
Motion tipped_by_rows(Random& random, double row_s, double turn_rad) {
  std::vector<double> times;
  std::vector<Pose> poses;
  const auto row = [&](const Vec3& at, const Eigen::Quaterniond& rotation) {
    times.push_back(static_cast<double>(times.size()) * row_s);
    poses.push_back({at, rotation});
  };
  row({0, 0, -1.2}, pitched(-0.3));
  row({3, 0, -1.2}, pitched(-0.3));
  row({3.2, 0, -1}, pitched(-1.3));
  row({3.2, 0, 3}, pitched(-1.3));
  double pitch = -1.3, roll = 0;
  for (int i = 0; i < 11; ++i) {
    pitch += random(-0.6, 1) * turn_rad;
    roll += random(-0.5, 0.5) * turn_rad;
    row({3.2, 0, 3}, from_rpy(0, pitch, 0) * from_rpy(roll, 0, 0));
  }
  return {times, poses};
}

TEST(Load, IsNeverMoreThanTheBucketHoldsHoweverManyUpdatesThereAre) {
  Random random(32);
  const std::pair<double, double> kinds[] = {{0.01, 0.03}, {0.1, 0.3}, {1, 0.7}, {3, 0.3}};
  for (int n = 0; n < 4; ++n) {
    const auto [row_s, turn_rad] = kinds[n];
    const Bucket bucket = random.bucket();
    const Motion motion = tipped_by_rows(random, row_s, turn_rad);
    const double voxel_m = random(0.08, 0.2);
    const std::vector<double>& rows_s = motion.times_s();
    std::vector<double> loads[3];
    for (int many = 0; many < 3; ++many) {
      SCOPED_TRACE(::testing::Message() << row_s << " s, " << turn_rad << " rad, " << many);
      Site site(voxel_m, bucket);
      double from_s = motion.begin_s();
      for (std::size_t i = 1; i < rows_s.size(); ++i) {
        const int updates = many == 0 ? 1 : many == 1 ? 3 : 30;
        if (many == 0 && i % 3 != 0 && i + 1 < rows_s.size()) continue;  // some hold three rows
        for (int k = 1; k <= updates; ++k) {
          const double to_s = k == updates ? rows_s[i] : from_s + (rows_s[i] - from_s) / 3;
          site.tracker.update(0, motion, from_s, to_s);
          from_s = to_s;
          if (k > updates - 2) {
            ASSERT_FALSE(site.holds_too_much(motion.pose(to_s)));
          }
          ASSERT_EQ(residual(site.tracker), 0);
        }
        if (i % 3 == 0) loads[many].push_back(site.load_m3());
      }
      const double last = site.load_m3();
      site.tracker.come_to_rest();
      EXPECT_EQ(site.load_m3(), last);
    }
    const double whole = *std::max_element(loads[0].begin(), loads[0].end());
    ASSERT_GT(whole, 0.01);
    for (const int many : {1, 2})
      for (std::size_t i = 0; i < loads[0].size(); ++i)
        EXPECT_NEAR(loads[many][i], loads[0][i], 0.005 * whole) << i;
  }
}

}  // namespace load_laws_test
}  // namespace soilvdb::test
