// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The passive force of a soil wedge on a blade, in one vertical slice.
#pragma once

#include <array>
#include <span>

namespace soilvdb::inline v0 {

/// What the force of a wedge depends on besides its shape. Also the order of derivatives.
struct WedgeSoil {
  double unit_weight = 0;    ///< N/m3
  double cohesion = 0;       ///< Pa
  double friction = 0;       ///< rad, in the soil
  double tool_friction = 0;  ///< rad, on the blade
  double adhesion = 0;       ///< Pa, on the blade
};
inline constexpr int kWedgeParameters = 5;

/// Ground and blade in a vertical slice: x is ahead of the lip, z above it, m. The blade rises
/// backwards from the lip.
struct SoilSlice {
  double first_x = 0, step = 0;     ///< places of the heights; between them the ground is straight
  std::span<const double> heights;  ///< of the ground, at least two
  double rake = 0;       ///< angle between the blade and the level behind the lip, rad, in (0, pi)
  double face = 0;       ///< length of the blade, m
  double surcharge = 0;  ///< pressure on the ground, Pa
  /// Soil beside the wedge moves with it on so many sides, 0 to 2, of a blade of this width, m.
  double open_sides = 0;
  double width = 0;
};

/// Force of the blade on the soil, per metre of its width.
struct WedgeForce {
  double ahead = 0, up = 0;            ///< N/m
  double side_ahead = 0, side_up = 0;  ///< the part of soil beside the wedge, on all open sides
  double push = 0;      ///< of the wedge's face on it; less than 0: it would fail without
  double arm = 0;       ///< where it acts: distance from the lip along the blade, m
  double failure = 0;   ///< angle of the failure plane with the way ahead, rad
  double depth = 0;     ///< of the lip below the ground, m
  double above = 0;     ///< area of the wedge's part above the blade, m2
  double above_x = 0;   ///< place of its centroid, m
  bool steep = false;   ///< a body of soil rides in front of a steep blade
  bool open = false;    ///< the wedge ends where the heights do
  bool buried = false;  ///< the blade ends below the ground
  bool stuck = false;   ///< no plane lets the soil fail; the force is then 0 in place of infinite
  std::array<double, kWedgeParameters> d_ahead{}, d_up{};  ///< derivatives by WedgeSoil's members
};

/// What slices of one blade know of the body of soil before it.
struct BodyGuess {
  double angle = 0;       ///< of its face in the last slice, rad; 0: not known
  bool hopeless = false;  ///< it needs far more force than none; no slice looks for one then
};

/// The least force at which the soil ahead of a blade fails, by the fundamental equation of
/// earthmoving (Reece 1965; McKyes, Soil Cutting and Tillage, 1985) on ground of any shape: over
/// all failure planes the least sum of weight, cohesion, adhesion and surcharge. Side crescents as
/// McKyes and Ali 1977. In front of a steep blade soil may ride as a body (Miedema, The Delft Sand,
/// Clay and Rock Cutting Model); the lesser force counts.
///
/// Guarantees: exact on the given ground but for rounding, a body within 1e-6; so are derivatives,
/// with a body within 1e-4. Zero where no soil is ahead. Does not allocate.
/// @param guess from a slice beside it; saves most of the time for a steep blade
WedgeForce wedge_force(const SoilSlice& slice, const WedgeSoil& soil, BodyGuess& guess) noexcept;
inline WedgeForce wedge_force(const SoilSlice& slice, const WedgeSoil& soil) noexcept {
  BodyGuess none;
  return wedge_force(slice, soil, none);
}

}  // namespace soilvdb::inline v0
