// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Volumes inside a boundary: what was dug and filled, and what a design still asks for.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "soilvdb/initial_terrain.h"
#include "soilvdb/io/site.h"

namespace soilvdb::inline v0 {

/// Heights at places of the world, m; NaN where there is no ground.
using Heights = std::function<void(std::span<const Vec2> xy_m, std::span<double> heights_m)>;

/// A surface's height() for many places. @param surface must outlive the result
Heights heights_of(const InitialTerrain& surface);

/// What a design asks for where both it and the ground are known.
struct ToDesign {
  double area_m2 = 0;
  double cut_m3 = 0, fill_m3 = 0;  ///< soil above the design; room below it
};

struct BoundaryVolume {
  double cut_m3 = 0, fill_m3 = 0, net_m3 = 0;  ///< against the ground before; net: fill - cut
  double error_m3 = 0;                         ///< error bound of cut, and of fill
  double area_m2 = 0;                          ///< of the boundary where the terrain has ground
  double off_site_m2 = 0;                      ///< the rest of it
  std::optional<ToDesign> to_design = {};
  std::optional<double> sigma_m3 =
      {};  ///< of net, by what scans say; by Session::volume() on request
};

/// @param before of the same lattice and initial terrain as the site's ground
/// @param boundary corners in the world, m; the last connects to the first; inside by the even-odd
///        rule
/// @param design null: none. Its volumes are sums over places: 250 000 at most, and where ground
///        changed instead one in each voxel's column, up to a million.
/// @throw std::invalid_argument for less than 3 or more than 4096 corners, one beyond 1e9 m, if
///        sides of the boundary cross, or without any ground inside
BoundaryVolume volume_inside(const io::Site& site, const Ground& before,
                             const std::vector<Vec2>& boundary, const Heights& now,
                             const InitialTerrain* design);

}  // namespace soilvdb::inline v0
