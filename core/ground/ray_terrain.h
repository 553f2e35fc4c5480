// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Terrains that know where rays meet them.
#pragma once

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// What an InitialTerrain may be as well.
class RayTerrain {
 public:
  virtual ~RayTerrain() = default;
  /// Distance at which a ray is first at or below the ground's height(), m, from `from_m` on;
  /// infinity if it never is. It passes places without ground. Threads may call it concurrently.
  /// @param direction of unit length
  virtual double meet(const Vec3& origin, const Vec3& direction, double from_m) const = 0;
};

}  // namespace soilvdb::inline v0
