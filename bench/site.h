// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A made-up site at any size: hills by formula, and machines that dig, swing, dump and move on.
#pragma once

#include <memory>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/initial_terrain.h"

namespace soilvdb::bench {

/// Height of the hills, +-6 m, slopes up to about 20 degrees, m.
double hill_height(double x, double y);
/// The same as posts 0.5 m apart about (0, 0), read by tile. @param side_m of the square it covers
std::shared_ptr<const InitialTerrain> make_hills(double side_m);

/// The bucket of a 20 t excavator, mouth only.
Bucket excavator_bucket();

/// An excavator that works along a line: cycles of twenty seconds, of which five in the ground, the
/// rest lifting, swinging to the side, dumping and swinging back; ten cycles from a place, side by
/// side and deeper, then it travels on.
class DigCycles {
 public:
  DigCycles(Vec2 start, double heading_rad) : start_(start), heading_rad_(heading_rad) {}
  Pose world_from_bucket(double time_s) const;

  static constexpr double kCycle_s = 20, kDig_s = 5;
  static constexpr int kCyclesPerPlace = 10;

 private:
  Vec2 start_;
  double heading_rad_;
};

/// Ten machines' cycles, spread over a site of 1 km.
std::vector<DigCycles> fleet();

}  // namespace soilvdb::bench
