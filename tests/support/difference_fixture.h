// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Flat ground, and trenches dug into it along half a sine.
#pragma once

#include <cmath>
#include <memory>
#include <numbers>

#include "soilvdb/tracker.h"

namespace soilvdb {

inline constexpr double kPi = std::numbers::pi;

inline Bucket bucket(double width_m, double height_m) {
  Bucket b;
  b.width_m = width_m;
  b.height_m = height_m;
  return b;
}

/// A mouth that stays upright while its lip follows half a sine below the ground.
struct HalfSine {
  Vec2 from{0.013, -0.027};
  double yaw = 0, width = 0.6, length = 2, depth = 0.3, level = 0;
  double area_m2() const { return width * length; }

  void dig(Ground& ground, double begin = 0, double end = 1) const {
    Tracker tracker(ground, {bucket(width, 1)});
    for (int i = 0; i <= 100; ++i) {
      const double s = begin + (end - begin) * i / 100;
      const Vec2 at = from + s * length * Vec2(std::cos(yaw), std::sin(yaw));
      tracker.update(0, {{at.x(), at.y(), level - depth * std::sin(kPi * s)}, from_rpy(0, 0, yaw)});
    }
  }
};

inline std::shared_ptr<const InitialTerrain> plane(double height_m,
                                                   const Vec2& slope = Vec2::Zero()) {
  return make_plane(height_m, slope);
}

}  // namespace soilvdb
