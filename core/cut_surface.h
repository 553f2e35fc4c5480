// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Level-set CSG: carves the volume a bucket sweeps over the last poses out of phi.
#pragma once

#include <span>
#include <vector>

#include "core/bucket.h"
#include "core/soil.h"
#include "core/sweep_distance.h"

namespace soilvdb {

/// The recent path of a bucket, as a swept volume.
///
/// One step sweeps a slab thinner than a voxel, whose back is no surface of anything. So the volume
/// is that of a window of history: closed at its front, where soil stands against the mouth, open
/// at its back unless the path begins there.
struct SweepWindow {
  std::span<const Pose> world_from_bucket;  ///< oldest first; two or more
  std::size_t fresh = 0;                    ///< the segments from this pose on are new
  bool begins = false;                      ///< the first pose is where the path starts
  bool mouth = true, body = false;          ///< what of the bucket has cut soil
};

/// A window's sweep on its way out of phi, chunk by chunk: phi = max(phi, -b) with b the signed
/// distance to the swept volume, m, b < 0 inside.
///
/// For the mouth, b is the distance to the surface its edges trail (by the gradient of the distance
/// across the edge at the time the mouth's plane passes a point), and to the mouth: where it stops
/// for points it passed, anywhere for others; for the body, the distance to it at each fresh pose.
/// Points passed near the window's open back are left alone, since what bounds the sweep there may
/// be forgotten; they got their distance when they were nearer its front. Chunks are independent of
/// each other, and phi only grows, so cuts may be carved in any order and in parts.
class SurfaceCut {
 public:
  SurfaceCut(const Soil& soil, const Bucket& bucket, const SweepWindow& window);
  /// The same with nothing to carve but these chunks, sorted.
  SurfaceCut(const Soil& soil, const Bucket& bucket, const SweepWindow& window,
             std::vector<Coord3> chunks);

  /// Origins of the chunks still to carve, sorted.
  std::span<const Coord3> pending() const { return std::span(chunks_).subspan(done_); }

  /// Carves the next `count` chunks, in parallel where there are many, and makes those that change
  /// and aren't resident. Soil::make() lists those whose phi changed.
  void carve(Soil& soil, std::size_t count);

 private:
  struct Near;  // what of the path is near a chunk
  void find_chunks(const Soil& soil, const Bucket& bucket);
  Advance advance(std::size_t i) const;
  Bounds bounds(std::size_t i, std::span<const Vec3> corners, double voxel_size_m) const;
  bool find_near(const Coord3& origin, Near& near) const;
  bool find_rows(Near& near) const;
  /// The first pose near which distances change: the window before ended between it and the next.
  std::size_t changing() const { return fresh_ > 0 ? fresh_ - 1 : 0; }
  bool carve_chunk(const Near& near, Phi& phi) const;

  SweepDistance sweep_;
  bool mouth_, body_;
  std::vector<Eigen::Matrix3d> axes_;  // of the bucket at each pose
  std::vector<Vec3> positions_;        // index space
  std::size_t fresh_;
  std::size_t settled_ = 0;  // the first segment that isn't near the open back
  bool begins_;
  float spacing_ = 0;  // half the longest segment, voxels: every point of the path is near a pose
  std::vector<Advance> advances_;  // over each segment
  std::vector<Bounds> bounds_;     // of each pose
  std::vector<Coord3> chunks_;
  std::size_t done_ = 0;
};

}  // namespace soilvdb
