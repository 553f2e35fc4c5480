// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Height of the topmost soil at a place.
#pragma once

#include <functional>
#include <map>
#include <optional>

#include "soilvdb/mesher.h"

namespace soilvdb::inline v0 {

/// Heights of the ground, read off its mesh where it is resident and off the base surface
/// elsewhere.
///
/// Keeps the patches it made, so many heights of one place cost little more than one. For one
/// thread; outlives no change of the soil. Within 0.15 voxel of the true height but at walls.
class SurfaceHeight {
 public:
  explicit SurfaceHeight(const Soil& soil);
  /// Height of the topmost soil at (x, y) of the world, m; nothing where there is none.
  std::optional<double> at(double x, double y);

 private:
  struct Patch {
    Mesh mesh;
    std::map<std::pair<int, int>, std::vector<std::uint32_t>> columns;  ///< triangles over each
  };
  const Patch& patch(const Coord3& block);

  const Soil& soil_;
  std::map<std::pair<int, int>, std::vector<int>> blocks_;  ///< of columns of blocks: their z
  std::map<Coord3, Patch, SurfaceMesh::Less> patches_;
};

/// Heights of a soil for several threads, each with a SurfaceHeight of its own.
std::function<std::optional<double>(double x, double y)> surface_heights(const Soil& soil);

/// One height. Many of one soil: SurfaceHeight.
std::optional<double> surface_height(const Soil& soil, double x, double y);

}  // namespace soilvdb::inline v0
