// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Closed polygons in the plane.
#pragma once

#include <algorithm>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

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

}  // namespace soilvdb::inline v0
