// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The flat polygons of a bucket, and the samples that one of them removes from a chunk.
#pragma once

#include <cstdint>
#include <vector>

#include "core/lattice/affine.h"
#include "soilvdb/bucket.h"
#include "soilvdb/samples.h"

namespace soilvdb::inline v0 {

/// A flat polygon of the bucket that cuts as it moves: the mouth, or a face of the body.
struct Facet {
  Pose bucket_from_facet;     ///< the polygon lies in x = 0 of the facet frame
  std::vector<Vec2> outline;  ///< convex or not, (y, z) in the facet frame, m
  Vec2 low, high;             ///< bounds of the outline
  bool rectangle = false;     ///< the outline is its bounds
};

/// The mouth first, then the faces of the body.
std::vector<Facet> facets(const Bucket& bucket);

/// A facet that moves along one segment of the path, relative to one chunk, in voxels. At time t
/// from -1 to 1 the coordinates of the chunk's points in the facet's frame are
///     x: u at -1, v at 1    y + t dy + (1 - t^2) bend_y    z + t dz + (1 - t^2) bend_z
/// and x bends likewise.
struct Stroke {
  Affine u, v, y, dy, z, dz;
  Affine bend[3];
  float y_low, y_high, z_low, z_high;  ///< bounds of the facet's outline
  float slack;                         ///< largest bend in the chunk

  Stroke() = default;
  /// @param from, middle, to the facet's frame at the start, half-way in time and at the end
  Stroke(const AffineFrame& from, const AffineFrame& middle, const AffineFrame& to,
         const Facet& facet, double voxel_size_m);
};

/// How a facet books removed samples. A bucket's body lies behind its mouth: soil that leaves
/// through the mouth backwards was first displaced by the body's back, in the same segment.
enum class Booking { kCaptured, kCapturedAhead, kDisplaced };

/// Removed soil, in samples of Ground::sample_m3().
struct Removed {
  std::int64_t captured = 0;   ///< through the mouth
  std::int64_t displaced = 0;  ///< by the body alone

  std::int64_t sum() const { return captured + displaced; }
  Removed& operator+=(const Removed& more) {
    captured += more.captured;
    displaced += more.displaced;
    return *this;
  }
};

/// What was removed, and the part of it that was loose.
struct Cut {
  Removed all, loose;

  Cut& operator+=(const Cut& more) {
    all += more.all;
    loose += more.loose;
    return *this;
  }
};

/// Removes the samples that the facet passes through, also from the loose ones among them.
/// @param origin of the chunk @param h voxel size, m
Cut cut_samples(Samples& samples, Samples& loose, const Coord3& origin, const Stroke& stroke,
                const Facet& facet, double h, Booking booking);

}  // namespace soilvdb::inline v0
