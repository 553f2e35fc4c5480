// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What soil does once it was moved, and what brings it or takes it away besides machines.
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// Soil that can move: what was moved is loose, what wasn't is bank.
struct SoilProperties {
  double repose_rad = 0;               ///< steepest that loose soil stands, in (0, pi / 2)
  double swell = 0;                    ///< loose volume over bank volume, less 1; >= 0
  double density_kg_m3 = 1800;         ///< of bank soil, > 0
  std::optional<double> cohesion_pa;   ///< of bank soil; without it bank stands as it was cut
  std::optional<double> friction_rad;  ///< of bank soil, in [0, pi / 2); without it repose_rad
};

/// Soil brought from elsewhere: a truck that tips, a conveyor. It falls straight down, evenly over
/// the time.
struct Pour {
  std::string name;
  Vec3 at_m = Vec3::Zero();
  double begin_s = 0, end_s = 0;  ///< the same: all at once
  double volume_m3 = 0;           ///< loose, > 0
};

/// A box that is open at its top: what falls into it leaves the site.
struct Hopper {
  std::string name;
  Eigen::AlignedBox2d box_m;
  double top_m = 0;                                           ///< height of its rim
  double begin_s = -std::numeric_limits<double>::infinity();  ///< it is there from here ...
  double end_s = std::numeric_limits<double>::infinity();     ///< ... to here
};

/// All of it; without `soil` soil doesn't move.
struct Earthmoving {
  std::optional<SoilProperties> soil;
  std::vector<Pour> pours;
  std::vector<Hopper> hoppers;

  /// @throw std::invalid_argument in one line for soil, a pour or a hopper that can't be
  void validate() const;
};

}  // namespace soilvdb::inline v0
