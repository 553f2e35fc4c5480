// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Strokes that don't go easy on the engine, and what to look at afterwards.
#pragma once

#include <cstdint>
#include <memory>

#include "core/bucket.h"
#include "core/soil.h"
#include "core/tracker.h"

namespace soilvdb::bench {

/// What is measured on the ground itself.
struct Health {
  std::uint64_t not_finite = 0;  ///< values of phi that are NaN, infinite or beyond the band
  std::uint64_t grown = 0;       ///< cells with soil that the untouched ground has not
  double residual_m3 = 0;        ///< change of the ground plus what the ledger says was cut
  std::uint64_t chunks = 0;
  double memory_bytes = 0;
};
Health health(const Soil& soil, const Tracker& tracker);

/// A bucket of 0.6 m x 0.4 m times `scale`.
Bucket small_bucket(double scale = 1);

/// A straight drag along a plane, the mouth upright on it, 1 m long and 0.2 m deep times `scale`.
struct Drag {
  double voxel_m = 0.025, scale = 1;
  Vec3 offset = Vec3::Zero();  ///< of the middle of the drag
  double yaw_rad = 0;          ///< direction on the plane before it is tilted
  double slope_rad = 0;        ///< of the plane, towards x
  int updates = 50;

  Vec3 origin() const;  ///< near the offset, a multiple of 100 m and of the scale
  std::unique_ptr<BaseSurface> ground() const;
  Pose pose(double s) const;  ///< lip at fraction s of the way
  double exact_m3() const { return 0.6 * 0.2 * 1.0 * scale * scale * scale; }
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

/// A pose over a patch of 2 m x 2 m, the lip between 0.5 m below and 0.2 m above 0, turned any way
/// that digs.
Pose random_pose(Random& random);

}  // namespace soilvdb::bench
