// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What columns of the world, or boxes of them, gained of soil, of any width, wherever voxels lie.
#pragma once

#include <array>
#include <functional>
#include <limits>
#include <vector>

#include "soilvdb/soil.h"

namespace soilvdb::inline v0 {

/// Boxes that tile the world: columns where they are as high as it is.
struct GainGrid {
  Vec3 origin;  ///< middle of box (0, 0, 0), world, m
  Vec3 side_m;
  using Box = std::array<int, 3>;
  Box at(const Vec3& p) const;

  static GainGrid columns(const Vec2& origin, double side_m) {
    return {{origin.x(), origin.y(), 0}, {side_m, side_m, std::numeric_limits<double>::infinity()}};
  }
};

/// What a box gained, and the variance of that.
struct Gain {
  double m3 = 0, variance = 0;
  void add(const Gain& other);
};

using GainFunction = std::function<void(const GainGrid::Box&, const Gain&)>;
/// Reads the samples of a chunk as they were and as they are.
using ReadChange = std::function<void(const Coord3&, SampleWords& before, SampleWords& after)>;

/// Calls `f` with what boxes gained in chunks of a soil, chunk by chunk, in their order: a cell
/// that changed whole shared out by volume, any other by its samples. Chunks in parallel, `f` not.
void for_each_gain(const Soil& soil, const std::vector<Coord3>& chunks, const ReadChange& read,
                   const GainGrid& grid, const GainFunction& f);

/// The same for a soil against its base surface, as far as its chunks meet a range of x. Without
/// one the sum is Soil::change_m3() to rounding.
void for_each_gain(const Soil& soil, const GainGrid& grid, const GainFunction& f,
                   const std::array<double, 2>& x_m = {-std::numeric_limits<double>::infinity(),
                                                       std::numeric_limits<double>::infinity()});

}  // namespace soilvdb::inline v0
