// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Takes the samples a moving bucket passes through out of the soil, and counts them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/bucket.h"
#include "core/soil.h"

namespace soilvdb {

/// A flat polygon of the bucket that cuts as it moves: the mouth, or a face of the body.
struct Facet {
  Pose bucket_from_facet;     ///< the polygon lies in x = 0 of the facet frame
  std::vector<Vec2> outline;  ///< convex or not, (y, z) in the facet frame, m
  Vec2 low, high;             ///< bounds of the outline
  bool rectangle = false;     ///< the outline is its bounds
};

/// The mouth first, then the faces of the body.
std::vector<Facet> facets(const Bucket& bucket);

/// What one call took away, in samples of Soil::sample_m3().
struct Cut {
  std::int64_t captured = 0;    ///< through the mouth
  std::int64_t displaced = 0;   ///< by the body alone
  std::vector<Coord3> changed;  ///< origins of the chunks that lost samples, sorted
};

/// Removes every sample that a facet passes through between consecutive poses of `path`, in order.
///
/// Guarantees: the union of what a path removes does not depend on where it is split; the same path
/// again removes nothing; the result is the same for any number of threads.
/// @param path world_from_bucket, as from Motion::trace(); fewer than two poses remove nothing
/// @throw NoGroundError where the terrain has no height; the soil has then lost nothing
Cut excavate(Soil& soil, std::span<const Facet> facets, std::span<const Pose> path);

/// Removes every sample inside the body at one pose (a bucket that starts in the ground).
Cut stamp(Soil& soil, const Bucket& bucket, const Pose& world_from_bucket);

}  // namespace soilvdb
