// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/site/machine.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/constants.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/motion.h"

namespace soilvdb::inline v0 {
namespace {

/// How far below the horizontal the mouth looks, rad.
double mouth_dip(const Pose& world_from_bucket) {
  return std::asin(std::clamp(-(world_from_bucket.rotation * Vec3::UnitX()).z(), -1.0, 1.0));
}

}  // namespace

Machine::Machine(Bucket bucket, const Ground& ground, Settler* settler)
    : bucket_((bucket.validate(), std::move(bucket))),
      excavator_(bucket_),
      extremes_(extremes(bucket_)),
      settler_(settler) {
  for (const Vec3& p : extremes_) radius_m_ = std::max(radius_m_, p.norm());
  ledger_.sample_m3 = ground.sample_m3();
  if (settler_ == nullptr) return;
  ledger_.units = settler_->units();
  capacity_ = Capacity::of(bucket_);
}

double Machine::tolerance_m(const Ground& ground) { return kPathTolerance * ground.voxel_size_m(); }

Update Machine::move(Ground& ground, const Pose& to) {
  const Ledger before = ledger_;
  const std::int64_t slid_before = begin_update();
  const bool turns = placed_ && to.rotation.coeffs() != current_.rotation.coeffs();
  constexpr double kNoTime = std::numeric_limits<double>::quiet_NaN();
  if (settler_ != nullptr && placed_) {
    if (travel_m(current_, to) == 0) pass_station(ground, kNoTime, Rest::kAll);
    for (const Pose& station : stations_to(ground, to)) {
      follow(ground, plan(ground, station), kNoTime);
      pass_station(ground, kNoTime, Rest::kSome);
    }
  }
  follow(ground, plan(ground, to), kNoTime);
  if (settler_ != nullptr) {
    swept_box_.extend(box_around(std::span(&to, 1)));
    if (turns) pass_turn(ground, kNoTime);
  }
  end_update();
  return since(before, slid_before);
}

Update Machine::move(Ground& ground, const Motion& motion, double begin_s, double end_s) {
  const Ledger before = ledger_;
  const std::int64_t slid_before = begin_update();
  double from_s = begin_s;
  if (settler_ != nullptr) {
    for (const auto& [time_s, kind, ticks] : events(ground, motion, begin_s, end_s)) {
      pass_rows(motion, from_s, time_s);
      follow(ground, plan(ground, motion, from_s, time_s), time_s);
      if (kind == Event::Kind::kTurn)
        pass_turn(ground, time_s);
      else if (kind == Event::Kind::kTick)
        pass_tick(ground, time_s, ticks);
      else
        pass_station(ground, time_s, kind == Event::Kind::kStandstill ? Rest::kAll : Rest::kSome);
      from_s = time_s;
    }
    pass_rows(motion, from_s, end_s);
  }
  follow(ground, plan(ground, motion, from_s, end_s), end_s);
  end_update();
  return since(before, slid_before);
}

std::string Machine::misplaced(const Ground& ground, const Pose& at) const {
  const Pose here[] = {at};
  return stays_in_air(ground, here, 0)
             ? ""
             : "the bucket can only be placed in the air above ground, a voxel or more from it";
}

Update Machine::place(Ground& ground, const Pose& at, double time_s) {
  const Ledger before = ledger_;
  const std::int64_t slid_before = begin_update();
  if (settler_ != nullptr) pass_station(ground, time_s, Rest::kEnd);
  const Pose here[] = {at};
  placed_ = true;
  current_ = last_station_ = at;
  since_station_m_ = 0;
  standing_ = {};
  swept_box_ = box_around(here);
  const bool dumps = bucket_.dump_angle_rad && mouth_dip(at) >= *bucket_.dump_angle_rad;
  if (dumps && ledger_.load > 0) dump(ground, at, time_s);
  if (settler_ != nullptr) pass_station(ground, time_s, Rest::kEnd);
  end_update();
  return since(before, slid_before);
}

/// Follows path_ without digging.
void Machine::approach(const Ground& ground, bool digs) {
  if (digs && !placed_) excavator_.require_ground(ground, std::span(path_).first(1));
  if (digs) excavator_.require_ground(ground, path_);
  placed_ = placed_ || digs;
  current_ = path_.back();
}

void Machine::require_ground(const Ground& ground, const Pose& to) {
  if (settler_ != nullptr && placed_)
    for (const Pose& station : stations_to(ground, to)) approach(ground, plan(ground, station));
  approach(ground, plan(ground, to));
}

void Machine::require_ground(const Ground& ground, const Motion& motion, double begin_s,
                             double end_s) {
  double from_s = begin_s;
  if (settler_ != nullptr) {
    for (const Event& event : events(ground, motion, begin_s, end_s)) {
      approach(ground, plan(ground, motion, from_s, event.time_s));
      from_s = event.time_s;
    }
  }
  approach(ground, plan(ground, motion, from_s, end_s));
}

Update Machine::since(const Ledger& before, std::int64_t slid_before) const {
  const auto loose_m3 = [&](std::int64_t mass) {
    return ledger_.units.loose_samples(mass) * ledger_.sample_m3;
  };
  Update update;
  update.cut_m3 = static_cast<double>(ledger_.cut() - before.cut()) * ledger_.sample_m3;
  update.bucket_m3 = ledger_.bucket_m3();
  update.spilled_m3 = loose_m3(ledger_.spilled - before.spilled);
  if (settler_ != nullptr) update.slid_m3 = loose_m3(settler_->totals().slid - slid_before);
  return update;
}

/// Follows path_ and books the cut. @param digs true if it may meet soil
void Machine::follow(Ground& ground, bool digs, double time_s) {
  if (digs && !placed_) {
    excavator_.require_ground(ground, std::span(path_).first(1));
    book(excavator_.stamp(ground, path_.front()));
    current_ = last_station_ = path_.front();
    swept_box_ = box_around(std::span(path_).first(1));
    placed_ = true;
  }
  if (digs) dig(ground, time_s);
  current_ = path_.back();
}

/// Makes path_ the way to a pose; only the pose if nothing can be dug. @return true if the way may
/// meet soil
bool Machine::plan(const Ground& ground, const Pose& to) {
  path_.assign(1, to);
  if (!placed_) return true;
  if (to.position == current_.position && to.rotation.coeffs() == current_.rotation.coeffs())
    return false;
  const Pose ends[] = {current_, to};
  const double turn = current_.rotation.angularDistance(to.rotation);
  const double h = ground.voxel_size_m();
  // A turning point leaves the chord between its ends by at most the height of its arc.
  if (stays_in_air(ground, ends, radius_m_ * (1 - std::cos(turn / 2)))) return false;
  path_.assign(1, current_);
  trace(current_, to, bucket_, kMaxBend * h, kPathStride * h, path_);
  return true;
}

/// The same along a motion: first coarsely, which is enough in the air.
bool Machine::plan(const Ground& ground, const Motion& motion, double begin_s, double end_s) {
  const double h = ground.voxel_size_m();
  if (placed_) {
    path_ = motion.trace(begin_s, end_s, bucket_, kCoarseBend * h, kAnyStride);
    if (stays_in_air(ground, path_, kCoarseBend * h)) return false;
  }
  path_ = motion.trace(begin_s, end_s, bucket_, kMaxBend * h, kPathStride * h);
  return true;
}

/// True if the bucket is certainly above the ground along a path and dumps no load.
/// @param bend_m largest distance of its points from the straight way between two poses
bool Machine::stays_in_air(const Ground& ground, std::span<const Pose> path, double bend_m) const {
  const bool may_dump = ledger_.load > 0 && bucket_.dump_angle_rad.has_value();
  Eigen::AlignedBox3d box;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Eigen::Matrix3d axes = path[i].rotation.toRotationMatrix();
    for (const Vec3& p : extremes_) box.extend(path[i].position + axes * p);
    if (!may_dump || i == 0) continue;
    const double turn = path[i - 1].rotation.angularDistance(path[i].rotation);
    if (std::max(mouth_dip(path[i - 1]), mouth_dip(path[i])) + turn >= *bucket_.dump_angle_rad)
      return false;
  }
  const Vec3 wide = Vec3::Constant(ground.voxel_size_m() + bend_m);
  const Eigen::AlignedBox3d around(box.min() - wide, box.max() + wide);
  return ground.is_air(around) && ground.terrain().has_data(around);
}

/// Digs path_ in parts between poses that dump, because a load leaves at a pose.
void Machine::dig(Ground& ground, double time_s) {
  const std::span<const Pose> path = path_;
  const auto looks_far_down = [&](std::size_t i) {
    return bucket_.dump_angle_rad && mouth_dip(path[i]) >= *bucket_.dump_angle_rad;
  };
  for (std::size_t from = 0, i = 0; i < path.size(); i += 2) {
    const bool dumps = looks_far_down(i) || (i > 0 && looks_far_down(i - 1));
    if (!dumps && i + 1 < path.size()) continue;
    book(excavator_.sweep(ground, path.subspan(from, i - from + 1)));
    if (dumps && ledger_.load > 0) dump(ground, path[i], time_s);
    from = i;
  }
}

void Machine::book(const Cut& cut) {
  ledger_.captured += cut.all.captured;
  ledger_.displaced += cut.all.displaced;
  const auto mass = [&](std::int64_t all, std::int64_t loose) {
    return (all - loose) * ledger_.units.bank + loose * ledger_.units.loose;
  };
  ledger_.load += mass(cut.all.captured, cut.loose.captured);
  if (settler_ != nullptr) pushed_ += mass(cut.all.displaced, cut.loose.displaced);
}

/// The whole load leaves the bucket at once.
void Machine::dump(const Ground& ground, const Pose& at, double time_s) {
  const std::int64_t mass = std::exchange(ledger_.load, 0);
  ledger_.dumped += mass;
  if (settler_ == nullptr) return;
  ledger_.spilled += mass;
  set_wall(ground, at);
  settler_->drop(spill_line(ground, at), (at.rotation * Vec3::UnitX()).head<2>(), mass, time_s);
}

Eigen::AlignedBox3d Machine::workspace(const Ground& ground, std::span<const Pose> path) const {
  Eigen::AlignedBox3d box;
  const auto add = [&](const Pose& pose) { box.extend(ground.index_from_world(pose.position)); };
  if (placed_) add(current_);
  for (const Pose& pose : path) add(pose);
  if (box.isEmpty()) return box;
  // The bucket, arcs between poses, and the rest of a chunk.
  Vec3 wide = Vec3::Constant(2 * radius_m_ / ground.voxel_size_m() + 2 * kChunkSide);
  if (settler_ != nullptr) {
    if (spilled_from_) add(*spilled_from_);
    for (const Eigen::AlignedBox3d* changed : {&swept_box_, &unsettled_box_, &propped_box_}) {
      if (changed->isEmpty()) continue;
      box.extend(ground.index_from_world(changed->min()));
      box.extend(ground.index_from_world(changed->max()));
    }
    may_slide_.each([&](const Coord2& tile) {
      box.extend(Vec3(tile.x(), tile.y(), box.min().z()));
      box.extend(Vec3(tile.x() + kChunkSide, tile.y() + kChunkSide, box.min().z()));
    });
    wide += Vec3(kSoilReachCells, kSoilReachCells, kMaxPlaceIndex);
  }
  return {box.min() - wide, box.max() + wide};
}

}  // namespace soilvdb::inline v0
