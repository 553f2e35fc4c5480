// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The digging tool: a bucket's mouth, and the outline of its body where one is given; or any shape.
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
  /// Side outline (x, z) of the body from the lip (0, 0) to the upper edge (0, height), x <= 0,
  /// not self-intersecting; closed by the mouth. Empty: the mouth alone digs.
  std::vector<Vec2> profile;
  /// The load leaves when the mouth looks this far below the horizontal, rad.
  std::optional<double> dump_angle_rad;
  /// In place of mouth and body a tool of any closed shape (tool_of()): it holds nothing and pushes
  /// aside what it passes. Width and height are then those of a mouth that reaches as far.
  std::shared_ptr<const ToolShape> shape = {};

  /// @throw std::invalid_argument naming the field, its value and what would be right.
  void validate() const;
};

/// The four corners of the mouth, in the bucket frame.
using Corners = std::array<Vec3, 4>;
inline Corners mouth_corners(const Bucket& bucket) {
  const double y = bucket.width_m / 2;
  return {Vec3(0, -y, 0), Vec3(0, y, 0), Vec3(0, -y, bucket.height_m), Vec3(0, y, bucket.height_m)};
}

/// The same at a pose, world.
inline Corners mouth_corners(const Bucket& bucket, const Pose& world_from_bucket) {
  const Eigen::Matrix3d axes = world_from_bucket.rotation.toRotationMatrix();
  const Vec3 &lip = world_from_bucket.position, y = bucket.width_m / 2 * axes.col(1);
  const Vec3 up = lip + bucket.height_m * axes.col(2);
  return {lip - y, lip + y, up - y, up + y};
}

/// The points that bound a bucket, in its frame: the mouth's corners and the body's outline.
std::vector<Vec3> extremes(const Bucket& bucket);

/// How far the fastest corner of the mouth moves between two poses, m.
inline double travel(const Corners& a, const Corners& b) {
  double most2 = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most2 = std::max(most2, (b[i] - a[i]).squaredNorm());
  return std::sqrt(most2);
}
inline double travel(const Bucket& bucket, const Pose& a, const Pose& b) {
  return travel(mouth_corners(bucket, a), mouth_corners(bucket, b));
}

}  // namespace soilvdb::inline v0
