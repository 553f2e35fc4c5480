// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Properties of soil that moves, and its sources and sinks besides machines.
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// Soil that moves: disturbed soil is loose, undisturbed soil is bank.
struct SoilProperties {
  double repose_rad =
      0;             ///< angle of repose of loose soil, in (0, pi / 2); 0: none, for forces only
  double swell = 0;  ///< ratio of loose to bank volume, minus 1; >= 0
  double density_kg_m3 = 1800;         ///< of bank soil, > 0
  std::optional<double> cohesion_pa;   ///< of bank soil; unset: cut banks do not fail
  std::optional<double> friction_rad;  ///< of bank soil, in [0, pi / 2); unset: repose_rad
  /// Of soil on steel, in [0, pi / 2), for forces only; unset: two thirds of friction.
  std::optional<double> tool_friction_rad = {};
  double adhesion_pa = 0;  ///< of bank soil on steel, >= 0, for forces only
};

/// Soil from outside the site: a truck that tips, a conveyor. It falls vertically at a constant
/// rate.
struct Pour {
  std::string name;
  Vec3 at_m = Vec3::Zero();
  double begin_s = 0, end_s = 0;  ///< equal: all soil falls at once
  double volume_m3 = 0;           ///< loose, > 0
};

/// A box with an open top: soil that falls into it leaves the site.
struct Hopper {
  std::string name;
  Eigen::AlignedBox2d box_m;
  double top_m = 0;                                           ///< height of the rim, world
  double begin_s = -std::numeric_limits<double>::infinity();  ///< start of the hopper's presence
  double end_s = std::numeric_limits<double>::infinity();     ///< end of the hopper's presence
};

/// Without `soil` no soil moves.
struct Earthmoving {
  std::optional<SoilProperties> soil;
  std::vector<Pour> pours;
  std::vector<Hopper> hoppers;

  /// @throw std::invalid_argument with one line for an invalid soil, pour or hopper
  void validate() const;
};

}  // namespace soilvdb::inline v0
