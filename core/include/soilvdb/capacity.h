// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The volume of loose soil that a bucket holds at an attitude, and the point where it spills.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "soilvdb/bucket.h"

namespace soilvdb::inline v0 {

struct BucketCapacity {
  double volume_m3 = 0;       ///< maximum loose volume
  Vec3 spill = Vec3::Zero();  ///< point of the mouth where surplus soil leaves, bucket frame, m
};

/// The capacity of a bucket with a body, for soil no steeper than its angle of repose. The rim is
/// the lip, the mouth's upper edge and the side plates' edges between them. The side plates have
/// the outline of the profile. If the mouth points down, the whole mouth is rim. Soil fills each
/// point of the body, and above a mouth that points up, that lies below
///
///     S(x, y) = min over the rim of (height + repose_slope * horizontal distance)
///
/// That is the largest heap that does not rise over the rim. For a mouth that points up and is
/// flatter than repose it is the struck volume plus a hipped roof.
///
/// Guarantees: exact if the lip is level or the mouth points up and is flatter than repose, else
/// within 2e-5 of the struck volume. The heading has no effect. The bits are equal on all CPUs.
/// at() takes microseconds for a profile of ten points. Immutable: threads may share it.
///
/// Limitations: distances are straight lines. Soil behind a ridge across the floor runs out as if
/// there were no ridge; a shelf above a mouth that points down is empty. Corners that fill from
/// below count as full.
///
///     if (const auto capacity = Capacity::of(bucket)) {
///       const BucketCapacity most =
///           capacity->at(world_from_bucket.rotation, std::tan(repose_angle_rad));
///       if (load_m3 > most.volume_m3) pour(world_from_bucket * most.spill, ...);
///     }
class Capacity {
 public:
  /// @return std::nullopt without a profile: the volume is then unlimited. @pre bucket is valid
  static std::optional<Capacity> of(const Bucket& bucket);

  /// Volume below the strike plane, the plane of the mouth.
  double struck_m3() const { return area_m2_ * width_m_; }
  /// Volume with a heap of slope 1:1 on a level strike plane: ISO 7451, SAE J296.
  double heaped_m3() const { return hold_m3(Vec3::UnitX(), 1); }

  /// @param world_from_bucket unit quaternion
  /// @param repose_slope tangent of the angle of repose, >= 0 (0: water)
  /// @param held_m how far up the mouth, from the lip, ground before it holds the soil in; counts
  /// if
  ///        the lip is lower than the upper edge
  /// @return `spill` is the rim point with the least S at the body's centroid: soil at capacity
  ///        reaches the rim there
  BucketCapacity at(const Eigen::Quaterniond& world_from_bucket, double repose_slope,
                    double held_m = 0) const;
  /// The part of the rim over which surplus soil leaves: of the edge on which `spill` of at() is,
  /// what is within a height of its lowest point.
  /// @param level_m that height, > 0: a rim is level to about a voxel
  /// @return its ends, bucket frame, m
  std::array<Vec3, 2> spill_line(const Eigen::Quaterniond& world_from_bucket, double repose_slope,
                                 double level_m) const;

 private:
  struct Edge {
    Vec3 from, along;  // along: unit
    double length_m;
    Vec3 least;  // the point where soil at capacity reaches it
  };

  explicit Capacity(const Bucket& bucket);
  double hold_m3(const Vec3& up, double repose_slope, double held_m = 0) const;
  Edge spill_edge(const Vec3& up, double repose_slope) const;

  double width_m_, height_m_;
  double area_m2_ = 0;
  Vec3 middle_ = Vec3::Zero();  // centroid of the body
  /// The profile as (distance behind the mouth, distance from the lip or from the upper edge along
  /// the mouth), m, counterclockwise.
  std::vector<Vec2> from_lip_, from_upper_edge_;
};

}  // namespace soilvdb::inline v0
