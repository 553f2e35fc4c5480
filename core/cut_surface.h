// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Level-set CSG: carves the volume a mouth sweeps over the last poses out of phi.
#pragma once

#include <span>
#include <vector>

#include "core/bucket.h"
#include "core/soil.h"

namespace soilvdb {

/// The recent path of a mouth, as a swept volume.
///
/// One step sweeps a slab thinner than a voxel, whose back is no surface of anything. So the volume
/// is that of a window of history: closed at its front, where soil stands against the mouth, open
/// at its back unless the path begins there.
struct SweepWindow {
  std::span<const Pose> world_from_bucket;   ///< oldest first
  bool begins = false;                       ///< the first pose is where the path starts
};

/// phi = max(phi, -b) with b the signed distance to the window's swept volume, m, b < 0 inside:
/// to the surface that the mouth's edges trail (first order in the window's spacing along the path,
/// exact across it) and to the mouth at the window's ends.
/// @return origins of the chunks whose phi changed, sorted. Chunks are made where it does.
std::vector<Coord3> cut_surface(Soil& soil, const Bucket& bucket, const SweepWindow& window);

/// phi = max(phi, -b) with b the signed distance to the bucket's body at each pose.
std::vector<Coord3> cut_surface_by_body(Soil& soil, const Bucket& bucket,
                                        std::span<const Pose> world_from_bucket);

}  // namespace soilvdb
