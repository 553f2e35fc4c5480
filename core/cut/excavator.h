// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Removes and counts the samples that a moving bucket passes through.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/cut/facet.h"
#include "core/ground/ground_writer.h"

namespace soilvdb::inline v0 {

/// The cutting part of a bucket. It keeps scratch memory between calls to avoid allocations; copies
/// begin without it.
///
/// Several excavators may dig one ground at once if their strokes touch different chunks.
class Excavator {
 public:
  explicit Excavator(const Bucket& bucket) : bucket_(bucket), facets_(facets(bucket)) {}
  Excavator(const Excavator& other) : bucket_(other.bucket_), facets_(other.facets_) {}

  /// Removes every sample that a facet passes through between consecutive poses of `path`, in
  /// order.
  ///
  /// Guarantees: the removed samples do not depend on how a path is split; the same path again
  /// removes nothing; the result is the same for any number of threads.
  /// @param path world_from_bucket, as from Motion::trace(): ends of segments with their middles in
  ///        time between; points bend less than kMaxBend. A single pose removes nothing.
  /// @throw NoGroundError, without any change, where the terrain has no height
  Cut sweep(Ground& ground, std::span<const Pose> path);

  /// As sweep(), or stamp() for a single pose, without removing samples. @throw NoGroundError
  void require_ground(const Ground& ground, std::span<const Pose> path);

  /// Removes every sample inside the body at one pose (a bucket that starts in the ground).
  Cut stamp(Ground& ground, const Pose& world_from_bucket);

 private:
  /// The place of a facet at a pose of the path, in index space.
  struct FacetPlace {
    Eigen::Matrix3d axes;  // columns are the facet's axes
    Vec3 position;
    Eigen::AlignedBox3d box;
    // Largest difference of the facet's coordinates over a chunk from those at its middle.
    float half_range[3];
  };
  /// A stroke on its way through a chunk: a facet in the segment that ends with a pose.
  struct StrokeRef {
    std::size_t facet, pose;
  };
  /// A chunk's strokes, in the order of the path.
  struct Work {
    std::size_t first, last;
    Cut cut;
  };

  Cut cut_by_shape(Ground& ground, std::span<const Pose> path) const;
  void find_places(const Ground& ground, std::span<const Pose> path);
  FacetPlace place(const Ground& ground, const Facet& facet, const Pose& world_from_bucket) const;
  void require_known(const Ground& ground, std::span<const Pose> path) const;
  Eigen::AlignedBox3d box(std::size_t pose) const;
  AffineFrame frame(std::size_t pose, std::size_t facet, const Coord3& origin) const;
  void find_strokes(const Coord3& origin, std::size_t first, std::size_t last, double voxel_size_m);
  bool dig(std::size_t edit, Samples& samples, Samples& loose, double voxel_size_m);
  std::int64_t clear_body(Samples& samples, const Coord3& origin, const Ground& ground,
                          const Pose& bucket_from_world) const;
  void sweep_part(Ground& ground, std::size_t first, std::size_t last, Cut& cut);

  Bucket bucket_;
  std::vector<Facet> facets_;
  std::vector<FacetPlace> places_;  // by pose, then facet
  std::vector<StrokeRef> strokes_;
  std::vector<GroundWriter::Edit> edits_;  // by chunk, as work_ is
  std::vector<Work> work_;
};

}  // namespace soilvdb::inline v0
