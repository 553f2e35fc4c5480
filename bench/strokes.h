// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Strokes that don't go easy on the engine, and what to look at afterwards.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/ground.h"
#include "soilvdb/tracker.h"

namespace soilvdb::bench {

/// What is measured on the ground itself.
struct Health {
  std::uint64_t not_finite = 0;  ///< distances that are NaN, infinite or beyond the band
  std::uint64_t grown = 0;       ///< cells with soil that the untouched ground has not
  double residual_m3 = 0;        ///< change of the ground plus what the ledger says was cut
  std::uint64_t chunks = 0;
  double memory_bytes = 0;
};
Health health(const Ground& ground, const Tracker& tracker);

/// A bucket of 0.6 m x 0.4 m times `scale`.
Bucket small_bucket(double scale = 1);

/// A straight drag along a plane, the mouth upright on it, 1 m long and 0.183 m deep times `scale`:
/// off the grid, in every direction.
struct Drag {
  double voxel_m = 0.025, scale = 1;
  Vec3 offset = Vec3(0.0137, -0.0071, 0.0031);  ///< of the middle of the drag
  double yaw_rad = 0.3;                         ///< direction on the plane before it is tilted
  double slope_rad = 0;                         ///< of the plane, towards x
  double depth_m = 0.183;                       ///< times scale
  int updates = 50;

  Vec3 origin() const;  ///< near the offset, a multiple of 100 m and of the scale
  std::unique_ptr<InitialTerrain> terrain() const;
  Pose pose(double s) const;  ///< lip at fraction s of the way
  double exact_m3() const { return 0.6 * depth_m * 1.0 * scale * scale * scale; }
  double cut_m3() const;  ///< of a drag on fresh ground
};

/// Uniform in [0, 1): SplitMix64.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  double next();
  double between(double low, double high) { return low + (high - low) * next(); }

 private:
  std::uint64_t state_;
};

/// A bucket that wanders about a patch of 2 m x 2 m: from one update to the next up to 0.1 m along
/// each axis and up to 0.1 rad about each.
class RandomStrokes {
 public:
  explicit RandomStrokes(std::uint64_t seed) : random_(seed) {}
  /// @param sunk_m the lip stays between 0.5 m below and 0.2 m above this depth
  Pose next(double sunk_m);

 private:
  Random random_;
  Vec3 position_ = Vec3::Zero();
  double roll_rad_ = 0, pitch_rad_ = 0, yaw_rad_ = 0;
};

/// A volume by counting points, with one standard deviation.
struct Count {
  double m3 = 0, sigma_m3 = 0;
};

/// The soil that a mouth passes through along a path, by the tests' oracle: membership of two
/// points at random in each box of `box_m`.
Count count_swept(const Bucket& bucket, const std::vector<Pose>& path,
                  const InitialTerrain& terrain, double box_m);

}  // namespace soilvdb::bench
