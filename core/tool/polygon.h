// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Closed polygons in the plane.
#pragma once

#include <cmath>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

inline double cross2(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Where a side that crosses a height crosses it, the same whichever way it is walked.
inline double crossing_x(const Vec2& a, const Vec2& b, double y) {
  const Vec2 &low = a.y() < b.y() ? a : b, &high = a.y() < b.y() ? b : a;
  return low.x() + (high.x() - low.x()) * (y - low.y()) / (high.y() - low.y());
}

/// Even-odd rule.
inline bool inside(const std::vector<Vec2>& polygon, const Vec2& p) {
  bool in = false;
  for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
    const Vec2 &a = polygon[i], &b = polygon[j];
    if ((a.y() > p.y()) != (b.y() > p.y()) && p.x() < crossing_x(a, b, p.y())) in = !in;
  }
  return in;
}

/// True if two sides cross. Sides that touch or overlap along a line do not cross.
inline bool crosses_itself(const std::vector<Vec2>& polygon) {
  const auto side = [](const Vec2& a, const Vec2& b, const Vec2& p) {
    return cross2(b - a, p - a);
  };
  for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
    const Vec2 &a = polygon[j], &b = polygon[i];
    for (std::size_t k = i + 1; k < polygon.size(); ++k) {
      const Vec2 &c = polygon[k - 1], &d = polygon[k];
      if (side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0) return true;
    }
  }
  return false;
}

/// Plan area, m^2, above 0 if the corners turn left. @param polygon must not cross itself
inline double signed_area(const std::vector<Vec2>& polygon) {
  double twice_m2 = 0;
  for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++)
    twice_m2 += cross2(polygon[j] - polygon[0], polygon[i] - polygon[0]);
  return twice_m2 / 2;
}

inline double area_of(const std::vector<Vec2>& polygon) { return std::abs(signed_area(polygon)); }

}  // namespace soilvdb::inline v0
