// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a sensor's standard deviations mean, and where its points are.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/constants.h"
#include "soilvdb/survey.h"

namespace soilvdb::inline v0 {

/// One of a sensor's standard deviations.
struct SensorSigma {
  double Sensor::*field;
  const char* name;        ///< of its argument
  std::string_view group;  ///< of keys in scenarios and in headers of scans
  const char* key;
  const char* unit;
};
inline constexpr SensorSigma kSensorSigmas[] = {
    {&Sensor::range_sigma_m, "range_sigma", "noise", "range", "m"},
    {&Sensor::range_squared_sigma_per_m, "range_squared_sigma", "noise", "range_squared", "1/m"},
    {&Sensor::mount_height_sigma_m, "mount_height_sigma", "mount", "height", "m"},
    {&Sensor::mount_tilt_sigma_rad, "mount_tilt_sigma", "mount", "tilt", "rad"},
    {&Sensor::mount_scale_sigma, "mount_scale_sigma", "mount", "scale", "of range"},
    {&Sensor::pose_shift_sigma_m, "pose_shift_sigma", "pose", "shift", "m"},
    {&Sensor::pose_turn_sigma_rad, "pose_turn_sigma", "pose", "turn", "rad"},
};

/// The keys of a group.
inline std::vector<std::string> sigma_keys(std::string_view group) {
  std::vector<std::string> keys;
  for (const SensorSigma& sigma : kSensorSigmas)
    if (sigma.group == group) keys.emplace_back(sigma.key);
  return keys;
}

/// How the ranges of a kind of sensor err. Another kind is another case of range_model().
struct RangeModel {
  RangeNoise noise;
  double floor_m;     ///< error that more rays do not average out
  double rays_alike;  ///< neighbours that err as one

  /// Standard deviation of a ray, m.
  template <typename T>
  T sigma(T range_m) const {
    return static_cast<T>(noise.sigma_m) + static_cast<T>(noise.squared_per_m) * range_m * range_m;
  }
};

inline RangeModel range_model(const Sensor& sensor) {
  const RangeNoise noise = {sensor.range_sigma_m, sensor.range_squared_sigma_per_m};
  if (noise.squared_per_m > 0) return {noise, kStereoFloorM, kStereoPixels};
  return {noise, kLidarFloorM, 1};
}

/// Makes points of a pose's frame points of the world. Many at once, by a matrix.
inline void place_points(const Pose& world_from_points, std::span<Vec3> points_m) {
  const Eigen::Matrix3d rotation = world_from_points.rotation.toRotationMatrix();
  for (Vec3& point : points_m) point = rotation * point + world_from_points.position;
}

}  // namespace soilvdb::inline v0
