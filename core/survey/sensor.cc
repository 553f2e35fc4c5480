// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <stdexcept>

#include "core/constants.h"
#include "core/lattice/text.h"
#include "core/survey/sensor_model.h"
#include "soilvdb/motion.h"

namespace soilvdb::inline v0 {
namespace {

struct KnownNoise {
  std::string_view model;
  RangeNoise noise;
};
/// Ouster's data sheet: 1.5 cm in good light to 3 cm. RealSense: Intel's tuning guide has
/// subpixel / (focal length * baseline); with 0.08 pixels, 337 pixels at 640 x 480, and baselines
/// of 50 and 95 mm.
constexpr KnownNoise kKnownNoises[] = {
    {"ouster_os1", {0.03, 0}},
    {"realsense_d435", {0, 0.08 / (337 * 0.050)}},
    {"realsense_d455", {0, 0.08 / (337 * 0.095)}},
};

}  // namespace

RangeNoise noise_of(std::string_view model) {
  std::string all;
  for (const KnownNoise& known : kKnownNoises) {
    if (known.model == model) return known.noise;
    all += std::string(all.empty() ? "" : ", ") + std::string(known.model);
  }
  throw std::invalid_argument("the noise of '" + std::string(model) + "' is not known; known are " +
                              all + ". Or give the sigmas of its ranges");
}

void Sensor::validate() const {
  if (const std::string what = validation_error(pose); !what.empty())
    throw std::invalid_argument("a sensor's pose: " + what);
  for (const SensorSigma& sigma : kSensorSigmas)
    if (const double value = this->*sigma.field; !(value >= 0 && value <= kMostSensorSigma))
      throw std::invalid_argument(std::string(sigma.name) + " is " + text(value) + " " +
                                  sigma.unit + "; it must be from 0 to " + text(kMostSensorSigma) +
                                  " " + sigma.unit);
  if (!(max_range_m > 0) || (std::isfinite(max_range_m) && max_range_m > kMostScanRangeM))
    throw std::invalid_argument("max_range is " + text(max_range_m) +
                                "; it must be more than 0 and at most " + text(kMostScanRangeM));
  if (range_sigma_m == 0 && range_squared_sigma_per_m == 0)
    throw std::invalid_argument("range_sigma and range_squared_sigma are 0; one must be more");
}

}  // namespace soilvdb::inline v0
