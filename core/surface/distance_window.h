// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A dug ground between its voxels.
#pragma once

#include <vector>

#include "core/surface/ground_tiles.h"

namespace soilvdb::inline v0 {

/// Distances of a dug ground at the voxels of a box, trilinear between them.
class DistanceWindow {
 public:
  enum Flag : std::uint8_t {
    kChanged = 1,    ///< the cell was dug
    kDifferent = 2,  ///< not the distance of the initial terrain
    kMissing = 4     ///< unknown: far from all dug ground
  };

  /// Voxels to read for a box in index space.
  static double cells(const Eigen::AlignedBox3d& box) {
    return (box.sizes().array().ceil() + 3).prod();
  }
  /// Sets the box. The functions below are for places in it.
  void read(GroundTiles::Reader& tiles, const Eigen::AlignedBox3d& box);

  struct Value {
    double distance_m;
    unsigned flags;  ///< union over the eight voxels around
  };
  Value at(const Vec3& index) const;

  /// The same for the sample points of a cell, to the bit. @param low its corner in the world
  /// @param h its side @param changed, soil get a bit of each point
  void at(const CellPoints& cell, const Vec3& low, double h, const Ground& ground,
          std::uint64_t& changed, std::uint64_t& soil) const;

  /// Flags of all places of a box.
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
  std::vector<std::uint8_t> flags_;  // of the eight voxels above each voxel, itself included
};

}  // namespace soilvdb::inline v0
