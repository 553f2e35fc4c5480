// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil mass in integer units, so that sums are exact in any order.
#pragma once

#include <cmath>
#include <cstdint>

#include "soilvdb/earthmoving.h"

namespace soilvdb::inline v0 {

/// Units of mass per sample of soil. For soil that never moves the unit is the sample.
struct MassUnits {
  std::int64_t bank = 1, loose = 1;

  MassUnits() = default;
  /// Rounds swell to 1 / 65536. The range is 10^14 samples: 10^7 m^3 at 2.5 cm.
  explicit MassUnits(const SoilProperties& soil)
      : bank(std::llround((1 + soil.swell) * kLoose)), loose(kLoose) {}

  /// Volume of a mass in the loose state, samples.
  double loose_samples(std::int64_t mass) const {
    return static_cast<double>(mass) / static_cast<double>(loose);
  }
  /// @param sample_m3 volume per sample. @return mass, kg
  double kg(std::int64_t mass, double sample_m3, const SoilProperties& soil) const {
    return static_cast<double>(mass) / static_cast<double>(bank) * sample_m3 * soil.density_kg_m3;
  }

 private:
  static constexpr std::int64_t kLoose = 1 << 16;
};

}  // namespace soilvdb::inline v0
