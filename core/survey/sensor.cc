// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <stdexcept>

#include "core/constants.h"
#include "core/lattice/text.h"
#include "soilvdb/motion.h"
#include "soilvdb/survey.h"

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

void require_sigma(double value, const char* field, double least, double most) {
  if (value >= least && value <= most) return;
  throw std::invalid_argument(std::string(field) + " is " + text(value) + "; it must be from " +
                              text(least) + " to " + text(most));
}

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
  require_sigma(range_sigma_m, "range_sigma", 0, kMostSensorSigma);
  require_sigma(range_squared_sigma_per_m, "range_squared_sigma", 0, kMostSensorSigma);
  if (range_sigma_m == 0 && range_squared_sigma_per_m == 0)
    throw std::invalid_argument("range_sigma and range_squared_sigma are 0; one must be more");
  require_sigma(mount_height_sigma_m, "mount_height_sigma", 0, kMostSensorSigma);
  require_sigma(mount_tilt_sigma_rad, "mount_tilt_sigma", 0, kMostSensorSigma);
  require_sigma(mount_scale_sigma, "mount_scale_sigma", 0, kMostSensorSigma);
  require_sigma(pose_shift_sigma_m, "pose_shift_sigma", 0, kMostSensorSigma);
  require_sigma(pose_turn_sigma_rad, "pose_turn_sigma", 0, kMostSensorSigma);
}

}  // namespace soilvdb::inline v0
