// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Signed distance to what a moving bucket sweeps, for the eight voxels of a row. All in voxels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/affine.h"
#include "core/bucket.h"

namespace soilvdb {

/// The band of phi, voxels.
inline constexpr float kBandVoxels = 3;

/// How far a point (0, y, z) of the mouth moves ahead over a segment, as a linear function.
struct Advance {
  float c = 0, y = 0, z = 0;
  float at(float py, float pz) const { return c + py * y + pz * z; }
};

/// What the mouth at a pose bounds of the sweep, other than by its edges as they move on.
struct Bounds {
  bool always = false;  ///< all of the mouth does: the path starts or ends here
  bool stops = false;   ///< parts may: there the mouth turns back
  bool bends = false;   ///< its edges turn, and their trails leave a gap on the outer side
};

/// The part of a path that is near a chunk.
struct SweptMouth {
  std::span<const AffineFrame> frames;      ///< of the bucket at each pose, for the chunk
  std::span<const std::uint32_t> crossing;  ///< segments that may pass the chunk, by first pose
  std::span<const std::uint32_t> close;     ///< poses whose mouth bounds the sweep near the chunk
  std::span<const Advance> advances;        ///< over each segment
  std::span<const Bounds> bounds;           ///< of each pose
  std::size_t settled;                      ///< segments before are near the window's open back
};

/// A bucket as a tool of level-set CSG.
class SweepDistance {
 public:
  SweepDistance(const Bucket& bucket, double voxel_size_m);

  /// A bound from below on the distance, squared, of a box to the mouth.
  /// @param p the box's middle in the bucket frame; @param reach its half sides along the frame
  float to_mouth2(const float* p, const float* reach) const;
  /// The same for the body.
  float to_body2(const float* p, const float* reach) const;

  /// Bit k is set where the row of voxels over (x, k + 0.5) may be within the band of the mouth at
  /// one of these poses, or at one less than `spacing` from it.
  std::uint32_t rows_near_mouth(std::span<const AffineFrame> frames,
                                std::span<const std::uint32_t> poses, float x, float spacing) const;

  /// phi = max(phi, -distance to the sweep) for the voxels with centres (x, 0.5...7.5, 0.5...7.5)
  /// from the chunk's corner. @param rows bit k: of those with y = k + 0.5
  /// @return whether any changed
  bool carve_by_mouth(const SweptMouth& mouth, float x, std::uint32_t rows,
                      std::int16_t* slab) const;
  /// The same for the body at one pose and a row with centres (x, y, 0.5...7.5).
  bool carve_by_body(const AffineFrame& frame, float x, float y, std::int16_t* row) const;

 private:
  float half_width_, height_;             // of the mouth
  std::vector<Eigen::Vector2f> outline_;  // of the body, x and z
  Eigen::AlignedBox2f outline_box_;
};

}  // namespace soilvdb
