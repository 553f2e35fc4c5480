// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/earthmoving.h"

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <string_view>

#include "core/constants.h"
#include "core/lattice/text.h"

namespace soilvdb::inline v0 {
namespace {

void require_given(bool good, std::string_view what) {
  if (!good) throw std::invalid_argument(std::string(what));
}

/// An angle, from 0 on or more than 0.
void check_angle(std::string_view name, double angle_rad, bool zero_is_good) {
  constexpr double kRightAngle = std::numbers::pi / 2;
  if ((angle_rad > 0 || (zero_is_good && angle_rad == 0)) && angle_rad < kRightAngle) return;
  const bool degrees = angle_rad > kRightAngle && angle_rad < 90;
  require_given(false, std::string(name) + " is " + text(angle_rad, 6) +
                           "; it must be in radians, " + (zero_is_good ? "at least" : "more than") +
                           " 0 and less than 1.5708" +
                           (degrees ? ": " + text(angle_rad, 6) + " degrees are " +
                                          text(angle_rad * kRightAngle / 90, 3)
                                    : ""));
}

void check_given(const SoilProperties& soil) {
  require_given(soil.repose_rad != 0, "soil that moves needs an angle of repose, in rad");
  check_angle("the angle of repose", soil.repose_rad, /*zero_is_good=*/false);
  if (soil.friction_rad)
    check_angle("the angle of friction", *soil.friction_rad, /*zero_is_good=*/true);
  // Every force checks its soil: no text of what is good.
  if (!(soil.swell >= 0 && soil.swell <= kMaxSwell))
    require_given(false, "swell is " + text(soil.swell, 6) +
                             "; it must be loose over bank volume less 1, a share from 0 to 3");
  if (!(soil.density_kg_m3 > 0 && std::isfinite(soil.density_kg_m3)))
    require_given(false,
                  "density is " + text(soil.density_kg_m3, 6) + " kg/m3; it must be more than 0");
  const double cohesion_pa = soil.cohesion_pa.value_or(0);
  require_given(cohesion_pa >= 0 && std::isfinite(cohesion_pa), "cohesion must be 0 or more");
  if (soil.tool_friction_rad)
    check_angle("the angle of tool friction", *soil.tool_friction_rad, /*zero_is_good=*/true);
  require_given(soil.adhesion_pa >= 0 && std::isfinite(soil.adhesion_pa),
                "adhesion must be 0 or more");
}

void check_given(const Pour& pour) {
  const std::string name = "pour '" + pour.name + "': ";
  require_given(pour.at_m.allFinite(), name + "its place must be finite");
  require_given(pour.volume_m3 > 0 && std::isfinite(pour.volume_m3),
                name + "its volume must be above 0");
  require_given(pour.begin_s <= pour.end_s, name + "it must not end before it begins");
  require_given(std::isfinite(pour.begin_s) && std::isfinite(pour.end_s - pour.begin_s),
                name + "its time must be finite");
}

void check_given(const Hopper& hopper) {
  const std::string name = "hopper '" + hopper.name + "': ";
  require_given(hopper.box_m.min().allFinite() && hopper.box_m.max().allFinite() &&
                    (hopper.box_m.sizes().array() > 0).all() && std::isfinite(hopper.top_m),
                name + "its box must be xmin, ymin, xmax, ymax, minima less than maxima");
  require_given(hopper.begin_s < hopper.end_s, name + "it must be gone later than it comes");
}

}  // namespace

void Earthmoving::validate() const {
  require_given(soil || (pours.empty() && hoppers.empty()),
                "pours and hoppers are for soil that moves; say how it does");
  if (soil) check_given(*soil);
  for (const Pour& pour : pours) check_given(pour);
  for (const Hopper& hopper : hoppers) check_given(hopper);
}

}  // namespace soilvdb::inline v0
