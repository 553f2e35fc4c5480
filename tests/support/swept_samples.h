// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a path takes out of ground that is soil everywhere, sample by sample: as the excavator did
// it, and as it must be by asking each sample about each face and segment, in double precision.
#pragma once

#include <map>
#include <span>
#include <vector>

#include "core/cut/excavator.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::test {

/// Samples by chunk; chunks of none are left out.
using SampleSet = std::map<Coord3, SampleWords, Before>;

/// Ground without an end, and what an excavator takes out of it.
struct Block {
  Ground ground;
  Excavator excavator;
  Cut cut;

  Block(const Bucket& bucket, double voxel_size_m);
  void sweep(std::span<const Pose> path);
  SampleSet removed() const;
};

/// A flat face of a bucket: its plane is x = 0 of its frame, its outline (y, z) there.
struct Face {
  Pose bucket_from_face;
  std::vector<Vec2> outline;
};
/// The mouth, the faces between the profile's points, the two sides.
std::vector<Face> faces(const Bucket& bucket);

/// What a path must remove, and what rounding decides.
struct Swept {
  SampleSet surely, perhaps;
};

/// Asks every sample of every chunk within a voxel of the path whether a face passes through it
/// in a segment: its coordinates at the segment's ends, bent as at its middle, say when it crosses
/// the plane and where that is. What is within 1e-4 voxels of being otherwise is `perhaps`.
/// @param path ends of segments and, between them, middles, as for Excavator::sweep()
Swept sweep_by_sample(const Bucket& bucket, double voxel_size_m, std::span<const Pose> path);

}  // namespace soilvdb::test
