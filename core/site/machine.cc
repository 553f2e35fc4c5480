// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/site/machine.h"

#include <algorithm>
#include <cmath>

#include "soilvdb/chunk_range.h"
#include "soilvdb/motion.h"

namespace soilvdb::inline v0 {
namespace {

// In voxels; a bucket's travel is that of its fastest corner.
constexpr double kTolerance = 1e-3;  ///< by which rows may be left out
constexpr double kStride = 16;       ///< between poses, so that boxes around segments stay small

constexpr double kFar = 1e300;

/// How far below the horizontal the mouth looks, rad.
double looks_down(const Pose& world_from_bucket) {
  return std::asin(std::clamp(-(world_from_bucket.rotation * Vec3::UnitX()).z(), -1.0, 1.0));
}

}  // namespace

Machine::Machine(Bucket bucket, const Soil& soil)
    : bucket_((bucket.validate(), std::move(bucket))),
      excavator_(bucket_),
      extremes_(extremes(bucket_)) {
  for (const Vec3& p : extremes_) radius_m_ = std::max(radius_m_, p.norm());
  ledger_.sample_m3 = soil.sample_m3();
}

double Machine::tolerance_m(const Soil& soil) { return kTolerance * soil.voxel_size_m(); }

Update Machine::booked(std::int64_t cut_before) const {
  const std::int64_t cut = ledger_.captured + ledger_.displaced - cut_before;
  return {static_cast<double>(cut) * ledger_.sample_m3, ledger_.bucket_m3()};
}

Update Machine::move(Soil& soil, const Pose& to) {
  if (!placed_) return dig_along(soil, {&to, 1});
  if (to.position == current_.position && to.rotation.coeffs() == current_.rotation.coeffs())
    return booked(ledger_.captured + ledger_.displaced);
  const Pose ends[] = {current_, to};
  const double turn = current_.rotation.angularDistance(to.rotation);
  const double h = soil.voxel_size_m();
  // A turning point leaves the chord between its ends by its arc's height at most.
  if (stays_in_air(soil, ends, radius_m_ * (1 - std::cos(turn / 2)))) {
    current_ = to;
    return booked(ledger_.captured + ledger_.displaced);
  }
  traced_.assign(1, current_);
  trace(current_, to, bucket_, kMostBend * h, kStride * h, traced_);
  return dig_along(soil, traced_);
}

Update Machine::move(Soil& soil, const Motion& motion, double begin_s, double end_s) {
  const double h = soil.voxel_size_m();
  if (placed_) {
    const auto path = motion.trace(begin_s, end_s, bucket_, h, kFar);
    if (stays_in_air(soil, path, h)) {
      current_ = path.back();
      return booked(ledger_.captured + ledger_.displaced);
    }
  }
  return dig_along(soil, motion.trace(begin_s, end_s, bucket_, kMostBend * h, kStride * h));
}

Update Machine::dig_along(Soil& soil, std::span<const Pose> path) {
  const std::int64_t cut_before = ledger_.captured + ledger_.displaced;
  if (!placed_) {
    ledger_.displaced += excavator_.stamp(soil, path.front()).displaced;
    current_ = path.front();
    placed_ = true;
  }
  dig(soil, path);
  current_ = path.back();
  return booked(cut_before);
}

/// Is the bucket surely above the ground all along a path, and no load of it dumped?
/// @param bend_m most that a point of the bucket leaves the straight way between two poses
bool Machine::stays_in_air(const Soil& soil, std::span<const Pose> path, double bend_m) const {
  const bool may_dump = ledger_.captured > ledger_.dumped && bucket_.dump_angle_rad.has_value();
  Eigen::AlignedBox3d box;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Eigen::Matrix3d axes = path[i].rotation.toRotationMatrix();
    for (const Vec3& p : extremes_) box.extend(path[i].position + axes * p);
    if (!may_dump || i == 0) continue;
    const double turn = path[i - 1].rotation.angularDistance(path[i].rotation);
    if (std::max(looks_down(path[i - 1]), looks_down(path[i])) + turn >= *bucket_.dump_angle_rad)
      return false;
  }
  const Vec3 wide = Vec3::Constant(soil.voxel_size_m() + bend_m);
  const Eigen::AlignedBox3d around(box.min() - wide, box.max() + wide);
  return soil.is_air(around) && soil.base().known(around);
}

/// A load leaves at a pose, so the path is dug from each pose that dumps to the next.
void Machine::dig(Soil& soil, std::span<const Pose> path) {
  const auto looks_far_down = [&](std::size_t i) {
    return bucket_.dump_angle_rad && looks_down(path[i]) >= *bucket_.dump_angle_rad;
  };
  for (std::size_t from = 0, i = 0; i < path.size(); i += 2) {
    const bool dumps = looks_far_down(i) || (i > 0 && looks_far_down(i - 1));
    if (!dumps && i + 1 < path.size()) continue;
    const Cut cut = excavator_.sweep(soil, path.subspan(from, i - from + 1));
    ledger_.captured += cut.captured;
    ledger_.displaced += cut.displaced;
    if (dumps) ledger_.dumped = ledger_.captured;
    from = i;
  }
}

Eigen::AlignedBox3d Machine::workspace(const Soil& soil, std::span<const Pose> path) const {
  Eigen::AlignedBox3d box;
  const auto add = [&](const Pose& pose) {
    for (const Vec3& p : extremes_) box.extend(soil.index_from_world(pose * p));
  };
  if (placed_) add(current_);
  for (const Pose& pose : path) add(pose);
  if (box.isEmpty()) return box;
  // Arcs between poses, and the rest of a chunk.
  const Vec3 wide = Vec3::Constant(radius_m_ / soil.voxel_size_m() + 2 * kChunkSide);
  return {box.min() - wide, box.max() + wide};
}

}  // namespace soilvdb::inline v0
