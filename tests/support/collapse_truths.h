// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where cohesionless ground comes to rest that stood too steep, in closed form, and how high a
// vertical cut stands in soil that has cohesion. Lengths in any unit; k is the tangent of the angle
// of repose, swell loose volume over bank volume.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

namespace soilvdb::test {

/// Where f changes its sign between low and high, at which it has different ones.
inline double root(const std::function<double(double)>& f, double low, double high) {
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    ((f(low) < 0) == (f(middle) < 0) ? low : high) = middle;
  }
  return low;
}

/// Height at which the new slope meets the old face of a wall: what went above, swollen, lies
/// below.
inline double wall_beta(double height, double swell) {
  return height * std::sqrt(swell) / (1 + std::sqrt(swell));
}

/// The same of a round pit's rim.
inline double pit_beta(double radius, double depth, double k, double swell) {
  return root(
      [&](double b) {
        const double u = b / k, v = (depth - b) / k;
        return u * u * radius / 2 - u * u * u / 6 - swell * (v * v * radius / 2 + v * v * v / 6);
      },
      0, std::min(depth, k * radius));
}

/// Height of the cone that a round tower comes to: rings of it gain or lose.
inline double tower_apex(double radius, double height, double k, double swell) {
  return root(
      [&](double a) {
        double sum = 0;
        constexpr double kStep = 0.01;
        for (double r = kStep / 2; r < a / k + radius; r += kStep) {
          const double gain = std::max(0.0, a - k * r) - (r < radius ? height : 0);
          sum += r * gain * (gain < 0 ? swell : 1);
        }
        return sum;
      },
      0, height);
}

/// Height up to which a vertical cut stands (Culmann 1866), m, and the slope of the plane along
/// which it fails, rad. @param weight_n_m3 of bank soil
inline double critical_height_m(double cohesion_pa, double friction_rad, double weight_n_m3) {
  return 4 * cohesion_pa / weight_n_m3 * std::tan(std::numbers::pi / 4 + friction_rad / 2);
}
inline double failure_plane_rad(double friction_rad) {
  return std::numbers::pi / 4 + friction_rad / 2;
}

}  // namespace soilvdb::test
