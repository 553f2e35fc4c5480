// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground that was dug between its voxels.
#pragma once

#include <vector>

#include "core/surface/ground_tiles.h"

namespace soilvdb::inline v0 {

/// What a box of the ground that was dug shows at its voxels, trilinear between them.
class DistanceWindow {
 public:
  enum Flag : std::uint8_t {
    kChanged = 1,    ///< somebody dug in the cell
    kDifferent = 2,  ///< the distance isn't the base surface's
    kMissing = 4     ///< not known: far from all that was dug
  };

  /// Voxels that are read for a box in index space.
  static double cells(const Eigen::AlignedBox3d& box) {
    return (box.sizes().array().ceil() + 3).prod();
  }
  /// The next box. What follows is for places in it.
  void read(GroundTiles::Reader& tiles, const Eigen::AlignedBox3d& box);

  struct Value {
    double distance_m;
    unsigned flags;  ///< of any of the eight voxels around
  };
  Value at(const Vec3& index) const;

  /// The same for the sample points of a cell, to the bit. @param low its corner in the world
  /// @param h its side @param changed, soil get a bit of each point
  void at(const CellPoints& cell, const Vec3& low, double h, const Ground& ground,
          std::uint64_t& changed, std::uint64_t& soil) const;

  /// What all places of a box have in common.
  struct Common {
    unsigned any = 0, all = ~0u;  ///< flags
    bool soil = false, air = false;
  };
  Common common(const Vec3& low, const Vec3& high) const;

 private:
  std::size_t place(const Coord3& cell) const {
    const Coord3 c = cell - first_;
    return static_cast<std::size_t>((c.x() * size_.y() + c.y()) * size_.z() + c.z());
  }
  void copy(const GroundTiles::Tile* tile, const Coord3& chunk);

  Coord3 first_, size_;
  std::vector<float> distances_;
  std::vector<std::uint8_t> flags_;  // of the eight voxels of which each is the lowest
};

}  // namespace soilvdb::inline v0
