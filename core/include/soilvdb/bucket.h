// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The digging tool: a bucket's mouth with an optional body outline, or a closed shape.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

class ToolShape;  // soilvdb/tool_shape.h

/// A bucket in its own frame: origin at the middle of the lip, y along the lip, z from the lip to
/// the upper edge, x out of the mouth. The mouth is {x = 0, |y| <= width/2, 0 <= z <= height}.
struct Bucket {
  double width_m = 0;
  double height_m = 0;
  /// Side outline (x, z) of the body, m, from the lip (0, 0) to the upper edge (0, height), x <= 0.
  /// The mouth closes it; it must not cross itself. Empty: only the mouth digs.
  std::vector<Vec2> profile;
  /// The bucket dumps its load when the mouth points this far below the horizontal, rad.
  std::optional<double> dump_angle_rad;
  /// A closed tool shape (tool_of()) that replaces mouth and body. It holds no soil and pushes soil
  /// aside. Width and height are then those of a mouth with the same reach.
  std::shared_ptr<const ToolShape> shape = {};
  double edge_m = 0;   ///< thickness of the lip's blunt edge, for its resistance; 0: sharp
  double plate_m = 0;  ///< thickness of each side plate's blunt edge, the same

  /// @throw std::invalid_argument with the field, its value and the allowed values
  void validate() const;
};

/// The four corners of the mouth, m, in the bucket frame.
using Corners = std::array<Vec3, 4>;
inline Corners mouth_corners(const Bucket& bucket) {
  const double y = bucket.width_m / 2;
  return {Vec3(0, -y, 0), Vec3(0, y, 0), Vec3(0, -y, bucket.height_m), Vec3(0, y, bucket.height_m)};
}

/// The corners of the mouth at a pose, m, in the world frame.
inline Corners mouth_corners(const Bucket& bucket, const Pose& world_from_bucket) {
  const Eigen::Matrix3d axes = world_from_bucket.rotation.toRotationMatrix();
  const Vec3 &lip = world_from_bucket.position, y = bucket.width_m / 2 * axes.col(1);
  const Vec3 up = lip + bucket.height_m * axes.col(2);
  return {lip - y, lip + y, up - y, up + y};
}

/// The mouth's corners and the vertices of the body's outline, m, in the bucket frame.
std::vector<Vec3> extremes(const Bucket& bucket);

/// Largest distance between the two positions of a mouth corner, m.
inline double travel(const Corners& a, const Corners& b) {
  double most2 = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most2 = std::max(most2, (b[i] - a[i]).squaredNorm());
  return std::sqrt(most2);
}
inline double travel(const Bucket& bucket, const Pose& a, const Pose& b) {
  return travel(mouth_corners(bucket, a), mouth_corners(bucket, b));
}

}  // namespace soilvdb::inline v0
