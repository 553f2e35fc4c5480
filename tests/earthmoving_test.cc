// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that is dug, carried, spilled and poured on a site: where it comes to lie, and that none is
// made or lost.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "core/settle/ground_window.h"
#include "soilvdb/capacity.h"
#include "soilvdb/tracker.h"

namespace soilvdb::testing {
namespace {

constexpr double kRepose = 0.61;
const double kSlope = std::tan(kRepose);

Earthmoving loam() {
  Earthmoving all;
  all.soil = SoilProperties{kRepose, 0.25, 1800, {}, {}};
  return all;
}

/// An excavator's bucket of 0.9 m^3 or so.
Bucket digger() {
  return {
      1.2, 0.9, {{0, 0}, {-0.45, -0.1}, {-0.85, 0.15}, {-0.95, 0.55}, {-0.7, 0.9}, {0, 0.9}}, {}};
}

/// What came and what is there, units of mass: 0 if none was made or lost.
std::int64_t residual(const Tracker& tracker) {
  const SiteLedger site = tracker.site();
  return site.ground + tracker.total().load + site.in_flight + site.hauled - site.poured;
}

/// Height of the highest soil.
double surface_top(const Soil& soil) {
  const GroundWindow window(soil, {-64, -64}, 128, 128);
  double top = -1e9;
  for (int x = 0; x < 128; ++x)
    for (int y = 0; y < 128; ++y) top = std::max(top, window.at(x, y).top);
  return (top + 0.5) * soil.voxel_size_m();
}

/// A dig along x in a trench `depth` deep, curled up at its end.
std::vector<Pose> drag(double from_x, double length, double depth, int steps) {
  std::vector<Pose> path;
  for (int i = 0; i <= steps; ++i) {
    const double s = static_cast<double>(i) / steps, curl = std::max(0.0, (s - 0.7) / 0.3);
    const double down = std::min(1.0, s / 0.15);
    path.push_back({{from_x + length * std::min(s / 0.85, 1.0), 0,
                     0.3 - (0.3 + depth) * down + 1.5 * std::max(0.0, (s - 0.8) / 0.2)},
                    from_rpy(0, 0.35 - 1.9 * curl, 0)});
  }
  return path;
}

TEST(Earthmoving, APourIsACone) {
  for (const double h : {0.1, 0.05}) {
    Earthmoving earthmoving = loam();
    earthmoving.pours.push_back({"truck", {0.013, -0.021, 3}, 0, 2, 1.0});
    Soil soil(h, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(soil, {}, earthmoving);
    const Update u = tracker.pour(0, 2);
    std::printf("pour %g: %g us\n", h, u.us);
    EXPECT_EQ(residual(tracker), 0);
    const double volume = 1.0, radius = std::cbrt(3 * volume / (std::numbers::pi * kSlope));
    EXPECT_NEAR(soil.change_m3(), volume, soil.sample_m3());
    const int half = static_cast<int>(2 / h);
    const GroundWindow window(soil, {-half, -half}, 2 * half + 1, 2 * half + 1);
    std::vector<double> off;
    for (int x = -half; x <= half; ++x) {
      for (int y = -half; y <= half; ++y) {
        const double z = (window.at(x + half, y + half).top) * h;
        const double d = std::hypot(x * h - 0.013, y * h + 0.021);
        if (d < 1.1 * radius) off.push_back(std::abs(z - std::max(0.0, kSlope * (radius - d))) / h);
      }
    }
    std::sort(off.begin(), off.end());
    double sum = 0;
    for (const double o : off) sum += o * o;
    const double rms = std::sqrt(sum / static_cast<double>(off.size()));
    std::printf("rms %g p99 %g max %g\n", rms, off[off.size() * 99 / 100], off.back());
    EXPECT_LE(rms, 0.25);
    EXPECT_LE(off[off.size() * 99 / 100], 0.5);
  }
}

TEST(Earthmoving, ADigFillsTheBucketAndPilesTheRest) {
  Soil soil(0.05, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(soil, {digger()}, loam());
  const Capacity capacity = *Capacity::of(digger());
  std::printf("struck %g heaped %g\n", capacity.struck_m3(), capacity.heaped_m3());
  double worst = 0, sum = 0;
  int n = 0;
  for (int pass = 0; pass < 3; ++pass) {
    tracker.update(0, Pose{{-4, 0, 2}, from_rpy(0, 0.35, 0)});
    for (const Pose& pose : drag(-3, 4, 0.3, 400)) {
      const Update u = tracker.update(0, pose);
      ASSERT_EQ(residual(tracker), 0);
      worst = std::max(worst, u.us);
      sum += u.us;
      ++n;
    }
    std::printf("load %g cut %g spilled %g slid %g; us mean %g max %g\n",
                tracker.total().bucket_m3(), tracker.total().cut_m3(), tracker.total().spilled_m3(),
                tracker.site().units.loose_samples(tracker.site().slid) * soil.sample_m3(), sum / n,
                worst);
    // Swing aside and tip.
    const Pose full = drag(-3, 4, 0.3, 400).back();
    for (int i = 0; i <= 60; ++i)
      tracker.update(0, Pose{full.position + Vec3(0, 4.0 * i / 60, 1), full.rotation});
    for (int i = 0; i <= 60; ++i) {
      const Update u = tracker.update(
          0, Pose{full.position + Vec3(0, 4, 1), from_rpy(0, -1.55 + 3.0 * i / 60, 0)});
      ASSERT_EQ(residual(tracker), 0);
      worst = std::max(worst, u.us);
    }
    std::printf("after tipping %g; max us %g\n", tracker.total().bucket_m3(), worst);
    tracker.come_to_rest();
    EXPECT_EQ(residual(tracker), 0);
  }
}

TEST(Earthmoving, AHeapThatIsDugIntoHasNoRoof) {
  constexpr double kVoxel = 0.05;
  Earthmoving earthmoving = loam();
  earthmoving.pours.push_back({"truck", {0, 0, 5}, 0, 0, 6.0});
  Soil soil(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  Bucket bucket = digger();
  Tracker tracker(soil, {bucket}, earthmoving);
  tracker.pour(0, 0);
  const double high = surface_top(soil);
  EXPECT_GT(high, 1.3);
  // Through the foot of the heap, far below its top.
  for (int i = 0; i <= 200; ++i) tracker.update(0, Pose{{-3 + 3.0 * i / 200, 0, 0.05}});
  for (int i = 0; i <= 100; ++i) tracker.update(0, Pose{{-3.0 * i / 100, 0, 0.05}});
  tracker.come_to_rest();
  EXPECT_EQ(residual(tracker), 0);
  EXPECT_LT(surface_top(soil), high - 0.2);
  const GroundWindow window(soil, {-64, -64}, 128, 128);
  EXPECT_FALSE(window.has_hanging());
}

}  // namespace
}  // namespace soilvdb::testing
