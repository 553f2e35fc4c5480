// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/machine.h"

#include <algorithm>
#include <cmath>

#include "core/chunk_range.h"
#include "core/motion.h"

namespace soilvdb {
namespace {

// In voxels; a bucket's travel is that of its fastest corner.
constexpr double kTolerance = 1e-3;  ///< by which rows may be left out
constexpr double kStride = 16;       ///< between poses, so that boxes around segments stay small
constexpr double kRefresh = 8;       ///< travel after which phi is carved anew
constexpr double kSpacing = 2;       ///< travel between the poses that phi is carved by
constexpr double kBend = 0.02;       ///< of the path between those poses
constexpr double kBetween = 0.2;     ///< travel between the poses by which bends are looked for
constexpr double kHistory = 16;      ///< travel a window remembers: a stretch, two bands, and some

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
  // A turning point leaves the chord between its ends by its arc's height at most.
  if (stays_in_air(soil, ends, radius_m_ * (1 - std::cos(turn / 2)))) return fly(soil, to);
  const double h = soil.voxel_size_m();
  traced_.assign(1, current_);
  trace(current_, to, bucket_, kMostBend * h, kStride * h, traced_);
  return dig_along(soil, traced_);
}

Update Machine::move(Soil& soil, const Motion& motion, double begin_s, double end_s) {
  const double h = soil.voxel_size_m();
  if (placed_) {
    const auto path = motion.trace(begin_s, end_s, bucket_, h, kFar);
    if (stays_in_air(soil, path, h)) return fly(soil, path.back());
  }
  return dig_along(soil, motion.trace(begin_s, end_s, bucket_, kMostBend * h, kStride * h));
}

Update Machine::dig_along(Soil& soil, std::span<const Pose> path) {
  const std::int64_t cut_before = ledger_.captured + ledger_.displaced;
  if (!placed_ && !path.empty()) place(soil, path.front());
  dig(soil, path);
  for (std::size_t i = 1; i < path.size(); ++i) keep_up(path[i], soil.voxel_size_m());
  carve(soil);
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
  const Vec3 wide = Vec3::Constant(soil.band_m() + bend_m);
  const Eigen::AlignedBox3d around(box.min() - wide, box.max() + wide);
  return soil.base().classify(around) == Content::kAir && soil.base().known(around);
}

/// Moves on where there is nothing to dig: what was swept before is no part of a later cut.
Update Machine::fly(Soil& soil, const Pose& to) {
  if (mouth_cut_ || body_cut_ || mouth_stood_) {
    carve_part(soil, 0);
    begin_carving(soil);
    mouth_stood_ = false;  // above the ground
  }
  const Corners at = mouth_corners(bucket_, to);
  moved_m_ += travel(at_, at);
  current_ = to;
  at_ = at;
  kept_.clear();
  between_.clear();
  fresh_ = 0;
  begins_ = true;
  carve_part(soil, 1 - moved_m_ / (kRefresh * soil.voxel_size_m()));
  return booked(ledger_.captured + ledger_.displaced);
}

void Machine::place(Soil& soil, const Pose& pose) {
  const Cut cut = excavator_.stamp(soil, pose);
  ledger_.displaced += cut.displaced;
  body_cut_ = cut.displaced > 0;
  current_ = pose;
  at_ = mouth_corners(bucket_, pose);
  placed_ = true;
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
    mouth_cut_ |= cut.captured > 0;
    body_cut_ |= cut.displaced > 0;
    from = i;
  }
}

/// Moves on, and keeps the pose left where the path bends or the last kept one is far enough.
void Machine::keep_up(const Pose& pose, double voxel_size_m) {
  const Corners to = mouth_corners(bucket_, pose);
  moved_m_ += travel(at_, to);
  if (kept_.empty() || travel(kept_at_, at_) >= kSpacing * voxel_size_m ||
      bends(to, kBend * voxel_size_m)) {
    kept_.push_back(current_);
    kept_at_ = at_;
    between_.clear();
  } else if (travel(between_.empty() ? kept_at_ : between_.back(), at_) >=
             kBetween * voxel_size_m) {
    between_.push_back(at_);
  }
  current_ = pose;
  at_ = to;
}

/// Is a pose since the last kept one off the straight way from there to the corners `to`?
bool Machine::bends(const Corners& to, double tolerance_m) const {
  for (std::size_t c = 0; c < to.size(); ++c) {
    const Vec3 &from = kept_at_[c], along = to[c] - from;
    const double length2 = along.squaredNorm(), by_length2 = length2 > 0 ? 1 / length2 : 0;
    const auto off = [&](const Corners& mid) {
      const Vec3 way = mid[c] - from;
      const double s = std::clamp(way.dot(along) * by_length2, 0.0, 1.0);
      return (way - s * along).squaredNorm() > tolerance_m * tolerance_m;
    };
    if (off(at_) || std::any_of(between_.begin(), between_.end(), off)) return true;
  }
  return false;
}

/// Carves on in step with the path, so that no single update bears it all: what the last stretch
/// swept is out of phi by the end of this one.
void Machine::carve(Soil& soil) {
  const double stretch_m = kRefresh * soil.voxel_size_m();
  carve_part(soil, 1 - moved_m_ / stretch_m);
  if (moved_m_ < stretch_m) return;
  begin_carving(soil);
  forget(kHistory * soil.voxel_size_m());
}

/// Carves until only this part of the stretch is left.
void Machine::carve_part(Soil& soil, double left) {
  if (!carving_) return;
  const auto keep =
      static_cast<std::size_t>(static_cast<double>(carving_chunks_) * std::max(0.0, left));
  const std::size_t pending = carving_->pending().size();
  if (pending > keep) carving_->carve(soil, pending - keep);
  if (keep == 0) carving_.reset();
}

/// The path since the last surface cut, up to the current pose, if it cut soil. So is the one after
/// that: where the last one ended the mouth bounded the sweep, and doesn't any more.
std::optional<Machine::Stretch> Machine::stretch() const {
  if (!mouth_cut_ && !body_cut_ && !mouth_stood_) return std::nullopt;
  Stretch s{kept_, fresh_, begins_, mouth_cut_ || mouth_stood_, body_cut_};
  s.path.push_back(current_);
  return s;
}

void Machine::begin_carving(const Soil& soil) {
  if (std::optional<Stretch> s = stretch()) {
    carved_ = std::move(*s);
    carving_.emplace(
        soil, bucket_,
        SweepWindow{carved_.path, carved_.fresh, carved_.begins, carved_.mouth, carved_.body});
    carving_chunks_ = carving_->pending().size();
  }
  mouth_stood_ = mouth_cut_;
  mouth_cut_ = body_cut_ = false;
  moved_m_ = 0;
}

void Machine::carve_ahead(Soil& soil) {
  std::optional<SurfaceCut> cuts[2] = {carving_, std::nullopt};
  if (const std::optional<Stretch> s = stretch()) {
    cuts[1].emplace(soil, bucket_, SweepWindow{s->path, s->fresh, s->begins, s->mouth, s->body});
  }
  for (std::optional<SurfaceCut>& cut : cuts) {
    if (!cut) continue;
    for (const Coord3& origin : cut->pending()) {
      Before& before = ahead_.emplace_back();
      before.origin = origin;
      if (Chunk* chunk = soil.find(origin)) {
        soil.warm(*chunk);
        before.resident = true;
        before.air = chunk->air;
        before.phi = chunk->phi;
      }
    }
    cut->carve(soil, cut->pending().size());
  }
}

void Machine::take_back(Soil& soil) {
  for (; !ahead_.empty(); ahead_.pop_back()) {
    Before& before = ahead_.back();
    if (before.resident) {
      Chunk& chunk = soil.make(before.origin);
      chunk.air = before.air;
      chunk.phi = std::move(before.phi);
    } else {
      soil.drop(before.origin);
    }
  }
}

/// Drops what is farther back than `length_m`.
void Machine::forget(double length_m) {
  double length = kept_.empty() ? 0 : travel(kept_at_, at_);
  std::size_t first = kept_.size();
  while (first > 0 && length < length_m) {
    --first;
    if (first > 0) length += travel(bucket_, kept_[first - 1], kept_[first]);
  }
  if (first > 0) begins_ = false;
  kept_.erase(kept_.begin(), kept_.begin() + static_cast<std::ptrdiff_t>(first));
  fresh_ = kept_.size();
}

Eigen::AlignedBox3d Machine::reach(const Soil& soil, std::span<const Pose> path) const {
  Eigen::AlignedBox3d box;
  const auto add = [&](const Pose& pose) {
    for (const Vec3& p : extremes_) box.extend(soil.index_from_world(pose * p));
  };
  if (placed_) add(current_);
  for (const Pose& pose : kept_) add(pose);
  for (const Pose& pose : carved_.path) add(pose);
  for (const Pose& pose : path) add(pose);
  if (box.isEmpty()) return box;
  // Arcs between poses, the band, and the rest of a chunk.
  const Vec3 wide = Vec3::Constant(radius_m_ / soil.voxel_size_m() + kBandVoxels + 2 * kLeafSide);
  return {box.min() - wide, box.max() + wide};
}

}  // namespace soilvdb
