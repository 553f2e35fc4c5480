// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/swept_boxes.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace soilvdb::inline v0::io {
namespace {

void put_corners(const Pose& world_from_bucket, const Corners& corners, Corners& world) {
  world.noalias() = world_from_bucket.rotation.toRotationMatrix() * corners;
  world.colwise() += world_from_bucket.position;
}

Box3 box_between(const Corners& a, const Corners& b) {
  // The sagitta of an arc up to half a turn is at most half its chord.
  const Vec3 bulge = Vec3::Constant(std::sqrt((b - a).colwise().squaredNorm().maxCoeff()) / 2);
  return {a.rowwise().minCoeff().cwiseMin(b.rowwise().minCoeff()) - bulge,
          a.rowwise().maxCoeff().cwiseMax(b.rowwise().maxCoeff()) + bulge};
}

}  // namespace

Corners bucket_corners(const Bucket& bucket) {
  std::vector<Vec3> all;
  for (const double y : {-bucket.width_m / 2, bucket.width_m / 2}) {
    for (const double z : {0.0, bucket.height_m}) all.emplace_back(0, y, z);
    for (const Vec2& p : bucket.profile) all.emplace_back(p.x(), y, p.y());
  }
  Corners corners(3, static_cast<Eigen::Index>(all.size()));
  for (std::size_t i = 0; i < all.size(); ++i) corners.col(static_cast<Eigen::Index>(i)) = all[i];
  return corners;
}

std::vector<StepBox> step_boxes(const Motion& motion, const Bucket& bucket, std::size_t first,
                                std::size_t last) {
  constexpr double kAnyDistance = std::numeric_limits<double>::infinity();
  const Corners corners = bucket_corners(bucket);
  const std::vector<double>& times = motion.times_s();
  std::vector<StepBox> boxes;
  boxes.reserve(last - first);
  Corners from, to, a, b;
  put_corners(motion.row(first), corners, from);
  for (std::size_t row = first; row < last; ++row) {
    const std::size_t next = std::min(row + 1, times.size() - 1);
    put_corners(motion.row(next), corners, to);
    boxes.push_back({row, box_between(from, to)});
    if (motion.row_pieces(next) > 1) {
      a = from;
      for (const Pose& pose :
           motion.trace(times[row], times[next], bucket, kAnyDistance, kAnyDistance)) {
        put_corners(pose, corners, b);
        boxes.back().box.extend(box_between(a, b));
        a.swap(b);
      }
    }
    from.swap(to);
  }
  return boxes;
}

void SweptBoxes::add(const Motion& part, const Bucket& bucket) {
  const std::size_t steps = std::max<std::size_t>(part.times_s().size() - 1, 1);
  for (std::size_t first = 0; first < steps; first += kStepsPerBox) {
    blocks_.emplace_back();
    for (const StepBox& step :
         step_boxes(part, bucket, first, std::min(first + kStepsPerBox, steps))) {
      blocks_.back().extend(step.box);
    }
  }
}

Box3 SweptBoxes::whole() const {
  Box3 whole;
  for (const Box3& block : blocks_) whole.extend(block);
  return whole;
}

}  // namespace soilvdb::inline v0::io
