// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Mass of soil in whole units, so that sums close exactly in any order.
#pragma once

#include <cmath>
#include <cstdint>

#include "soilvdb/earthmoving.h"

namespace soilvdb::inline v0 {

/// What a sample of soil counts. Soil that never moves is counted in samples.
struct MassUnits {
  std::int64_t bank = 1, loose = 1;

  MassUnits() = default;
  /// Swell to 1 / 65536. That leaves room for 10^14 samples, 10^7 m^3 at 2.5 cm.
  explicit MassUnits(const SoilProperties& soil)
      : bank(std::llround((1 + soil.swell) * kLoose)), loose(kLoose) {}

  /// Volume of a mass when it is loose, samples.
  double loose_samples(std::int64_t mass) const {
    return static_cast<double>(mass) / static_cast<double>(loose);
  }
  /// @param sample_m3 of a sample; @return kg
  double kg(std::int64_t mass, double sample_m3, const SoilProperties& soil) const {
    return static_cast<double>(mass) / static_cast<double>(bank) * sample_m3 * soil.density_kg_m3;
  }

 private:
  static constexpr std::int64_t kLoose = 1 << 16;
};

}  // namespace soilvdb::inline v0
