// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What columns of the world, or boxes of them, gained of soil, of any width, wherever voxels lie.
#pragma once

#include <array>
#include <functional>
#include <limits>
#include <vector>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Boxes that tile the world: columns where they are as high as it is.
struct VolumeBins {
  Vec3 origin;  ///< middle of box (0, 0, 0), world, m
  Vec3 side_m;
  using Box = std::array<int, 3>;
  Box at(const Vec3& p) const;

  static VolumeBins columns(const Vec2& origin, double side_m) {
    return {{origin.x(), origin.y(), 0}, {side_m, side_m, std::numeric_limits<double>::infinity()}};
  }
};

/// What a box gained, and the variance of that.
struct VolumeChange {
  double m3 = 0, variance = 0;
  void add(const VolumeChange& other);
};

using VolumeChangeFunction = std::function<void(const VolumeBins::Box&, const VolumeChange&)>;
/// Reads the samples of a chunk as they were and as they are.
using ReadBeforeAndAfter =
    std::function<void(const Coord3&, SampleWords& before, SampleWords& after)>;

/// Calls `f` with what boxes gained in chunks of a ground, chunk by chunk, in their order: a cell
/// that changed whole shared out by volume, any other by its samples. Chunks in parallel, `f` not.
void for_each_volume_change(const Ground& ground, const std::vector<Coord3>& chunks,
                            const ReadBeforeAndAfter& read, const VolumeBins& bins,
                            const VolumeChangeFunction& f);

/// The same for a ground against its base surface, as far as its chunks meet a range of x. Without
/// one the sum is Ground::change_m3() to rounding.
void for_each_volume_change(const Ground& ground, const VolumeBins& bins,
                            const VolumeChangeFunction& f,
                            const std::array<double, 2>& x_m = {
                                -std::numeric_limits<double>::infinity(),
                                std::numeric_limits<double>::infinity()});

}  // namespace soilvdb::inline v0
