// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Digs that tests and benchmarks share: named families, each at any offset and orientation.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/initial_terrain.h"
#include "soilvdb/motion.h"

namespace soilvdb::test {

/// Where a dig is put: a rotation about z, then a shift. The ground moves along; only a raster
/// stays aligned with the axes, so its exact volume depends on the rotation.
struct Placement {
  double yaw_rad = 0;
  Vec3 offset = Vec3::Zero();  ///< m
};

/// One dig with its ground.
struct Dig {
  std::string family;
  Placement placement;
  Bucket bucket;
  Motion motion;
  std::shared_ptr<const InitialTerrain> terrain;
  Vec3 origin = Vec3::Zero();  ///< for Ground
  double exact_m3 = 0;         ///< volume the mouth passes through, by the oracle
  double uncertainty_m3 = 0;   ///< of exact_m3, by comparing finer with coarser quadrature
};

/// Names of all families, in a fixed order.
const std::vector<std::string>& families();

/// A dig of a family. Its exact volume is computed on first use and remembered for the process.
/// @throw std::invalid_argument for an unknown family.
Dig make_dig(const std::string& family, const Placement& placement);

/// Placements used by default: off-grid offsets, several yaws (0, 33 degrees, ...).
std::vector<Placement> placements();

/// A randomised dig (drag, curl and swing mixed) on a sloped plane; the same for the same seed.
Dig random_dig(std::uint64_t seed);

}  // namespace soilvdb::test
