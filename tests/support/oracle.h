// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The truth that digs are measured against: volumes of swept sets, from the continuous motion
// alone.
#pragma once

#include <functional>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/types.h"

namespace soilvdb::test {

/// A rectangle that sweeps: x = 0, y in [y_low, y_high], z in [0, z_high] of its own frame.
struct Blade {
  Pose bucket_from_blade;
  double y_low = 0, y_high = 0, z_high = 0;
};

/// A rigid motion of blades over [0, 1], exact at all times.
struct Sweep {
  std::vector<Blade> blades;
  std::function<Pose(double)> world_from_bucket;
  std::vector<double> kinks;  ///< times where the velocity jumps
};

/// Soil is where z < height(x, y).
struct Terrain {
  std::function<double(const Vec2&)> height;
  bool flat = false;  ///< height is a linear function
};

struct Volume {
  double m3 = 0, uncertainty_m3 = 0;
};

/// The bucket's mouth.
Blade mouth(const Bucket& bucket);
/// The faces between the points of the bucket's profile; none without a profile.
std::vector<Blade> profile_faces(const Bucket& bucket);

/// Volume of the soil that a sweep passes through, each point once.
///
/// Along a line a moving plane meets it in one point that moves without jumps. So the swept set
/// meets the line in the ranges of that point over the intervals of time when it lies inside the
/// blade. The interval ends are found by bisection on the exact motion, the measure of the union of
/// the ranges is clipped by the terrain, and integrated over parallel lines. Four shifted lattices
/// of lines tell the uncertainty, three standard errors.
/// @param direction of the lines; no blade may keep parallel to it for a time
Volume spatial_volume(const Sweep& sweep, const Terrain& terrain, const Vec3& direction);

/// The same where all blades have the same y range and the motion stays in the x-z plane: lines in
/// that plane at `slices` values of y (1 if the terrain doesn't depend on y).
Volume planar_volume(const Sweep& sweep, const Terrain& terrain, const Vec3& direction, int lines,
                     int slices);

/// Is there a time at which a blade passes through the point?
bool passes_through(const Sweep& sweep, const Vec3& p);

/// spatial_volume() by points instead of lines: one point at random in each of sides^3 boxes;
/// the uncertainty is three standard errors.
Volume sampled_volume(const Sweep& sweep, const Terrain& terrain, int sides, unsigned seed);

}  // namespace soilvdb::test
