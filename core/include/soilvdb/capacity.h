// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How much loose soil a bucket holds at any attitude, and where more leaves it.
#pragma once

#include <optional>
#include <vector>

#include "soilvdb/bucket.h"

namespace soilvdb::inline v0 {

/// What a bucket holds at an attitude.
struct BucketCapacity {
  double volume_m3 = 0;       ///< at most, of loose soil
  Vec3 spill = Vec3::Zero();  ///< point of the mouth over which more leaves, bucket frame
};

/// The capacity of a bucket with a body, for soil that stands no steeper than its angle of repose.
/// Its rim is the lip, the upper edge of the mouth and the edges of the side plates between them;
/// side plates have the outline of the profile; of a mouth that looks down all is rim. Soil is
/// where a point is below
///
///     S(x, y) = min over the rim of (height + repose_slope * horizontal distance)
///
/// inside of the body, and above a mouth that looks up. That is the largest heap that doesn't reach
/// over the rim. Where the mouth looks up and is flatter than repose it is the struck volume and a
/// hipped roof.
///
/// Guarantees: exact where the lip is level or the mouth looks up and is flatter than repose, else
/// within 2e-5 of the struck volume. Heading doesn't matter. The same bits on any CPU. Some
/// microseconds for a profile of ten points. Immutable: threads may share it.
///
/// Caveats: distances are straight, so soil behind a ridge across the floor is taken to run out as
/// if the ridge weren't there, and a shelf above a mouth that looks down to be empty. Corners that
/// are filled from below count as full.
///
///     if (const auto capacity = Capacity::of(bucket)) {
///       const BucketCapacity most =
///           capacity->at(world_from_bucket.rotation, std::tan(repose_angle_rad));
///       if (load_m3 > most.volume_m3) pour(world_from_bucket * most.spill, ...);
///     }
class Capacity {
 public:
  /// Nothing for a bucket without a profile, which holds any amount. @pre bucket is valid
  static std::optional<Capacity> of(const Bucket& bucket);

  /// Below the strike plane, which is the mouth's.
  double struck_m3() const { return area_m2_ * width_m_; }
  /// Heaped at 1:1 above the strike plane held level: ISO 7451, SAE J296.
  double heaped_m3() const { return hold_m3(Vec3::UnitX(), 1); }

  /// @param world_from_bucket unit
  /// @param repose_slope tangent of the angle of repose, 0 (water) or more
  /// `spill` is the point of the rim that is least, as in S, from the middle of the body: soil at
  /// capacity reaches up to the rim there.
  BucketCapacity at(const Eigen::Quaterniond& world_from_bucket, double repose_slope) const;

 private:
  explicit Capacity(const Bucket& bucket);
  double hold_m3(const Vec3& up, double repose_slope) const;
  Vec3 spill(const Vec3& up, double repose_slope) const;

  double width_m_, height_m_;
  double area_m2_ = 0;
  Vec3 middle_ = Vec3::Zero();  // of the body
  /// The profile: how far behind the mouth, and how far from the lip towards the upper edge, or
  /// from the upper edge towards the lip. Counterclockwise.
  std::vector<Vec2> from_lip_, from_upper_edge_;
};

}  // namespace soilvdb::inline v0
