// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/earthmoving.h"

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace soilvdb::inline v0 {
namespace {

void require(bool good, const std::string& what) {
  if (!good) throw std::invalid_argument(what);
}

void check(const SoilProperties& soil) {
  constexpr double kRightAngle = std::numbers::pi / 2;
  require(soil.repose_rad > 0 && soil.repose_rad < kRightAngle,
          "the angle of repose must be more than 0 and less than pi / 2 rad");
  constexpr double kMostSwell = 100;  // beyond any soil, and what mass is counted in would overflow
  require(soil.swell >= 0 && soil.swell <= kMostSwell, "swell must be 0 or more, and at most 100");
  require(soil.density_kg_m3 > 0 && std::isfinite(soil.density_kg_m3),
          "density must be more than 0");
  const double friction_rad = soil.friction_rad.value_or(soil.repose_rad);
  require(friction_rad >= 0 && friction_rad < kRightAngle,
          "the angle of friction must be 0 or more and less than pi / 2 rad");
  const double cohesion_pa = soil.cohesion_pa.value_or(0);
  require(cohesion_pa >= 0 && std::isfinite(cohesion_pa), "cohesion must be 0 or more");
}

void check(const Pour& pour) {
  const std::string name = "pour '" + pour.name + "': ";
  require(pour.at_m.allFinite(), name + "its place must be finite");
  require(pour.volume_m3 > 0 && std::isfinite(pour.volume_m3), name + "its volume must be above 0");
  require(pour.begin_s <= pour.end_s, name + "it must not end before it begins");
  require(std::isfinite(pour.begin_s) && std::isfinite(pour.end_s - pour.begin_s),
          name + "its time must be finite");
}

void check(const Hopper& hopper) {
  const std::string name = "hopper '" + hopper.name + "': ";
  require(hopper.box_m.min().allFinite() && hopper.box_m.max().allFinite() &&
              (hopper.box_m.sizes().array() > 0).all() && std::isfinite(hopper.top_m),
          name + "its box must be xmin, ymin, xmax, ymax, minima less than maxima");
  require(hopper.begin_s < hopper.end_s, name + "it must be gone later than it comes");
}

}  // namespace

void Earthmoving::validate() const {
  require(soil || (pours.empty() && hoppers.empty()),
          "pours and hoppers are for soil that moves; say how it does");
  if (soil) check(*soil);
  for (const Pour& pour : pours) check(pour);
  for (const Hopper& hopper : hoppers) check(hopper);
}

}  // namespace soilvdb::inline v0
