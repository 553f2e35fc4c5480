// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Volume changes in columns or boxes of the world, of any width and independent of the voxels.
#pragma once

#include <array>
#include <functional>
#include <limits>
#include <vector>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Boxes that tile the world; columns have infinite height.
struct VolumeBins {
  Vec3 origin;  ///< centre of box (0, 0, 0), world, m
  Vec3 side_m;
  using Box = std::array<int, 3>;
  Box at(const Vec3& p) const;

  static VolumeBins columns(const Vec2& origin, double side_m) {
    return {{origin.x(), origin.y(), 0}, {side_m, side_m, std::numeric_limits<double>::infinity()}};
  }
};

/// The gain of a box and its variance.
struct VolumeChange {
  double m3 = 0, variance = 0;
  void add(const VolumeChange& other);
};

using VolumeChangeFunction = std::function<void(const VolumeBins::Box&, const VolumeChange&)>;
/// Reads the samples of a chunk before and after.
using ReadBeforeAndAfter =
    std::function<void(const Coord3&, SampleWords& before, SampleWords& after)>;

/// Calls `f` with the gain of each changed box, chunk by chunk in order. Cells that changed
/// completely are shared out by volume, others by sample. Only the chunks run in parallel, not `f`.
void for_each_volume_change(const Ground& ground, const std::vector<Coord3>& chunks,
                            const ReadBeforeAndAfter& read, const VolumeBins& bins,
                            const VolumeChangeFunction& f);

/// The changes of a ground against its initial terrain, in chunks that intersect the range `x_m` of
/// x. Without a range the sum is Ground::change_m3() up to rounding.
void for_each_volume_change(const Ground& ground, const VolumeBins& bins,
                            const VolumeChangeFunction& f,
                            const std::array<double, 2>& x_m = {
                                -std::numeric_limits<double>::infinity(),
                                std::numeric_limits<double>::infinity()});

}  // namespace soilvdb::inline v0
