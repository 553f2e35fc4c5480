// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Closed polygons in the plane.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "core/types.h"

namespace soilvdb {

/// Even-odd rule.
inline bool inside(const std::vector<Vec2>& polygon, const Vec2& p) {
  bool in = false;
  for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
    const Vec2 &a = polygon[i], &b = polygon[j];
    if ((a.y() > p.y()) != (b.y() > p.y()) &&
        p.x() < a.x() + (b.x() - a.x()) * (p.y() - a.y()) / (b.y() - a.y())) {
      in = !in;
    }
  }
  return in;
}

/// Distance to the polygon's border, negative inside.
inline double signed_distance(const std::vector<Vec2>& polygon, const Vec2& p) {
  double best = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
    const Vec2 along = polygon[j] - polygon[i], to = p - polygon[i];
    const double length2 = along.squaredNorm();
    const double s = length2 > 0 ? std::clamp(to.dot(along) / length2, 0.0, 1.0) : 0.0;
    best = std::min(best, (to - s * along).norm());
  }
  return inside(polygon, p) ? -best : best;
}

}  // namespace soilvdb
