// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Short forms of `bench stability`: nothing becomes NaN, no soil appears, the ledger telescopes.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "core/surface/surface.h"
#include "tests/support/dig_runner.h"
#include "tests/support/sanitized.h"

namespace soilvdb {
namespace stability_test {

/// Four standard errors of a cut with `surface_m2` of surface in all directions. A plane cuts at
/// most 3 cells per face of a cell.
double sampling_bound_m3(double surface_m2, double h) {
  return 4 * test::count_error_m3(h, 3 * surface_m2 / (h * h), kCountError);
}

constexpr double kWidth_m = 0.6, kHeight_m = 0.4, kDepth_m = 0.2, kLength_m = 1;

Bucket bucket(double scale = 1) {
  Bucket b;
  b.width_m = kWidth_m * scale;
  b.height_m = kHeight_m * scale;
  return b;
}

/// A straight drag along a plane, the mouth upright on it.
struct Drag {
  double h = 0.025, scale = 1, yaw_rad = 0.3, slope_rad = 0;
  Vec3 offset = Vec3(0.013, -0.007, 0.0031);

  Vec3 origin() const { return (offset / (100 * scale)).array().round().matrix() * (100 * scale); }
  std::unique_ptr<InitialTerrain> terrain() const {
    const double slope = std::tan(slope_rad);
    return make_plane(offset.z() - slope * offset.x(), {slope, 0});
  }
  Pose pose(double s) const {
    Pose p;
    p.rotation = Eigen::AngleAxisd(-slope_rad, Vec3::UnitY()) * from_rpy(0, 0, yaw_rad);
    p.position = offset + p.rotation * (scale * Vec3(kLength_m * (s - 0.5), 0, -kDepth_m));
    return p;
  }
  Pose above(double s) const {
    Pose p = pose(s);
    p.position.z() += 2 * scale;
    return p;
  }
  double exact_m3() const { return kWidth_m * kDepth_m * kLength_m * std::pow(scale, 3); }
  double bound_m3() const {
    const double walls = 2 * (kDepth_m * kLength_m + kDepth_m * kWidth_m + kLength_m * kWidth_m);
    return sampling_bound_m3(walls * scale * scale, h);
  }
};

void drag_once(Tracker& tracker, const Drag& drag, int updates = 20) {
  tracker.update(0, drag.above(0));
  for (int i = 0; i <= updates; ++i) tracker.update(0, drag.pose(static_cast<double>(i) / updates));
  tracker.update(0, drag.above(1));
}

/// Distances are finite and within the band, no cell has soil that it did not have, and what the
/// ground lost is what the ledger says.
void expect_sound(const Ground& ground, Tracker& tracker) {
  const Ground untouched(
      ground.voxel_size_m(), ground.origin(),
      std::shared_ptr<const InitialTerrain>(&ground.terrain(), [](const InitialTerrain*) {}));
  SampleWords before, now;
  float phi_m[kChunkVoxels];
  long bad = 0, grown = 0;
  const float band = static_cast<float>(ground.band_m());
  for (const Chunk* chunk : ground.chunks()) {
    untouched.read_samples(chunk->origin, before);
    ground.read_samples(chunk->origin, now);
    surface_distance(ground, chunk->origin, phi_m);
    for (std::size_t i = 0; i < kChunkVoxels; ++i) {
      bad += !std::isfinite(phi_m[i]) || std::abs(phi_m[i]) > band;
      grown += (now[i] & ~before[i]) != 0;
    }
  }
  EXPECT_EQ(bad, 0) << "distances";
  EXPECT_EQ(grown, 0) << "cells with new soil";
  const double cut = tracker.total().cut_m3();
  const double rounding = std::numeric_limits<double>::epsilon() * std::max(cut, 1e-9) * 4;
  EXPECT_NEAR(ground.change_m3(), -cut, rounding);
}

double cut_m3(const Drag& drag) {
  Ground ground(drag.h, drag.origin(), drag.terrain());
  Tracker tracker(ground, {bucket(drag.scale)});
  for (int i = 0; i <= 20; ++i) tracker.update(0, drag.pose(i / 20.0));
  expect_sound(ground, tracker);
  return tracker.total().cut_m3();
}

TEST(Stability, RandomStrokesLeaveTheGroundSound) {
  Ground ground(0.1, Vec3::Zero(), make_plane(0, {0.1, -0.05}));
  Tracker tracker(ground, {bucket()});
  std::srand(1);
  const auto between = [](double low, double high) {
    return low + (high - low) * std::rand() / RAND_MAX;
  };
  for (int i = 0; i < 3000; ++i) {
    Pose pose;
    pose.position = {between(-1, 1), between(-1, 1), between(-0.5, 0.2)};
    pose.rotation = from_rpy(between(-0.5, 0.5), between(-1.2, 1.2), between(-3, 3));
    tracker.update(0, pose);
  }
  expect_sound(ground, tracker);
  EXPECT_GT(tracker.total().cut_m3(), 1);
}

TEST(Stability, TheSameStrokeAgainCutsNothingMore) {
  const Drag drag;
  Ground ground(drag.h, drag.origin(), drag.terrain());
  Tracker tracker(ground, {bucket()});
  drag_once(tracker, drag);
  const double first = tracker.total().cut_m3();
  for (int n = 0; n < 100; ++n) drag_once(tracker, drag);
  EXPECT_EQ(tracker.total().cut_m3(), first);
  expect_sound(ground, tracker);
}

TEST(Stability, ALipOnTheSurfaceCutsNothingAndOnVoxelPlanesWhatItShould) {
  for (const double voxels : {0.0, 0.5, 1.0, 2.0}) {
    Drag drag;
    drag.yaw_rad = 0;
    drag.offset = Vec3::Zero();
    Ground ground(drag.h, drag.origin(), drag.terrain());
    Tracker tracker(ground, {bucket()});
    for (int i = 0; i <= 20; ++i) {
      Pose pose = drag.pose(i / 20.0);
      pose.position.z() = -voxels * drag.h;
      tracker.update(0, pose);
    }
    const double exact = kWidth_m * kLength_m * voxels * drag.h;
    EXPECT_NEAR(tracker.total().cut_m3(), exact, voxels == 0 ? 0 : drag.bound_m3()) << voxels;
    expect_sound(ground, tracker);
  }
}

TEST(Stability, StandingAndMotionsOfANanometreCutNothing) {
  const Drag drag;
  Ground ground(drag.h, drag.origin(), drag.terrain());
  Tracker tracker(ground, {bucket()});
  for (int i = 0; i < 1000; ++i) {
    Pose pose = drag.pose(0);
    if (i % 3 == 1) pose.position.x() += 1e-9 * (i % 7);
    if (i % 3 == 2) pose.rotation = pose.rotation * Eigen::AngleAxisd(1e-9, Vec3::UnitY());
    tracker.update(0, pose);
  }
  EXPECT_LE(tracker.total().cut_m3(), kWidth_m * kDepth_m * 1e-7 + 2 * ground.sample_m3());
  expect_sound(ground, tracker);
}

TEST(Stability, ADragInStepsOfAMicrometreIsTheSameDrag) {
  const Drag drag;
  double cut[2];
  for (int n = 0; n < 2; ++n) {
    Ground ground(drag.h, drag.origin(), drag.terrain());
    Tracker tracker(ground, {bucket()});
    const int steps = n == 0 ? 1 : 10000;
    for (int i = 0; i <= steps; ++i) tracker.update(0, drag.pose(0.01 * i / steps));
    cut[n] = tracker.total().cut_m3();
    expect_sound(ground, tracker);
  }
  // A sample within rounding of a pose's plane may fall to either side, but not between two steps.
  EXPECT_NEAR(cut[0], cut[1], 0.001 * cut[0] + 2 * drag.h * drag.h * drag.h / 64);
}

TEST(Stability, TurningOverFromRowToRowLeavesTheGroundSound) {
  for (int axis = 0; axis < 3; ++axis) {
    const Drag drag;
    Ground ground(drag.h, drag.origin(), drag.terrain());
    Tracker tracker(ground, {bucket()});
    const int rows = test::kLong ? 40 : 10;
    for (int i = 0; i <= rows; ++i) {
      Pose pose = drag.pose(static_cast<double>(i) / rows);
      if (i % 2 == 1) {
        pose.rotation = pose.rotation * Eigen::AngleAxisd(std::numbers::pi, Vec3::Unit(axis));
      }
      tracker.update(0, pose);
    }
    expect_sound(ground, tracker);
  }
}

TEST(Stability, ARowThatJumps100MetresCutsATrenchOf100Metres) {
  Drag drag;
  drag.h = 0.1;
  Ground ground(drag.h, drag.origin(), drag.terrain());
  Tracker tracker(ground, {bucket()});
  tracker.update(0, drag.pose(0));
  tracker.update(0, drag.pose(100));
  EXPECT_NEAR(tracker.total().cut_m3(), 100 * drag.exact_m3(), 10 * drag.bound_m3());
  expect_sound(ground, tracker);
}

TEST(Stability, VoxelSizesFromAMillimetreToAMetre) {
  for (const double scale : {0.04, 0.2, 1.0, 4.0, 40.0}) {
    Drag drag;
    drag.scale = scale;
    drag.h = 0.025 * scale;
    EXPECT_NEAR(cut_m3(drag), drag.exact_m3(), drag.bound_m3()) << drag.h;
  }
}

TEST(Stability, ASceneTimesAThousandErrsTheSame) {
  for (const double scale : {0.05, 50.0}) {
    Drag drag;
    drag.scale = scale;
    drag.h *= scale;
    drag.offset *= scale;
    EXPECT_NEAR(cut_m3(drag), drag.exact_m3(), drag.bound_m3()) << scale;
  }
}

TEST(Stability, CoordinatesOfAnySize) {
  for (const double at : {0.0, 5e5, 5e6, 1.3e7}) {
    Drag drag;
    drag.offset = {at + 0.37, at / 10 + 0.11, 0.013};
    EXPECT_NEAR(cut_m3(drag), drag.exact_m3(), drag.bound_m3()) << at;
  }
}

TEST(Stability, SlopesUpTo85Degrees) {
  for (const double degrees : {0, 30, 60, 85}) {
    Drag drag;
    drag.slope_rad = degrees * std::numbers::pi / 180;
    EXPECT_NEAR(cut_m3(drag), drag.exact_m3(), drag.bound_m3()) << degrees;
  }
}

}  // namespace stability_test
}  // namespace soilvdb
