// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// When and where the soil that a machine moves comes to rest.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "core/constants.h"
#include "core/site/machine.h"
#include "soilvdb/tool_shape.h"

namespace soilvdb::inline v0 {
namespace {

/// Sine of half the angle.
double half_turn(const Pose& from, const Pose& to) {
  return (from.rotation.conjugate() * to.rotation).vec().norm();
}

}  // namespace

double Machine::station_travel_m(const Ground& ground) const {
  return std::max(kMinStationVoxels * ground.voxel_size_m(), kStationRadiusShare * radius_m_);
}

/// Approximate travel of the bucket's fastest point.
double Machine::travel_m(const Pose& from, const Pose& to) const {
  return (to.position - from.position).norm() + 2 * half_turn(from, to) * radius_m_;
}

/// The stations on the straight way to a pose.
std::vector<Pose> Machine::stations(const Ground& ground, const Pose& to) {
  std::vector<Pose> found;
  const double whole_m = travel_m(current_, to), every_m = station_travel_m(ground);
  for (double at_m = every_m - travel_m_; at_m <= whole_m; at_m += every_m)
    found.push_back(interpolate(current_, to, at_m / whole_m));
  travel_m_ = std::fmod(travel_m_ + whole_m, every_m);
  return found;
}

/// Stations and ends of turns in (begin, end], and the beginnings of standstills in [begin, end).
/// They are counted from row to row, so they do not depend on the updates.
std::vector<Machine::Stop> Machine::stops(const Ground& ground, const Motion& motion,
                                          double begin_s, double end_s) {
  const double every_m = station_travel_m(ground);
  const std::vector<double>& rows_s = motion.times_s();
  std::vector<Stop> found;
  auto next = std::upper_bound(rows_s.begin(), rows_s.end(), begin_s);
  if (next == rows_s.begin()) ++next;
  for (; next < rows_s.end() && *(next - 1) < end_s; ++next) {
    const auto row = static_cast<std::size_t>(next - rows_s.begin());
    const double from_s = rows_s[row - 1], to_s = rows_s[row];
    const double way_m = travel_m(motion.row(row - 1), motion.row(row));
    if (way_m == 0 && from_s >= begin_s) found.push_back({from_s, Stop::Kind::kStandstill});
    double at_m = every_m - travel_m_;
    for (; at_m <= way_m; at_m += every_m) {
      const double at_s = std::min(to_s, from_s + (to_s - from_s) * (at_m / way_m));
      if (at_s > begin_s && at_s <= end_s) found.push_back({at_s, Stop::Kind::kStation});
    }
    if (to_s <= end_s) travel_m_ = std::max(0.0, every_m - (at_m - way_m));
    if (!capacity_) continue;
    const double turn_rad =  // or a bit more
        std::numbers::pi * half_turn(motion.row(row - 1), motion.row(row));
    const int turns = static_cast<int>(std::ceil(turn_rad / kSpillTurnRad));
    for (int i = 1; i <= turns; ++i) {
      const double at_s = i == turns ? to_s : from_s + (to_s - from_s) * i / turns;
      if (at_s > begin_s && at_s <= end_s) found.push_back({at_s, Stop::Kind::kTurn});
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Stop& a, const Stop& b) { return a.time_s < b.time_s; });
  return found;
}

/// Adds the bucket's places at the rows in (begin, end] to swept_box_.
void Machine::pass_rows(const Motion& motion, double begin_s, double end_s) {
  const std::vector<double>& rows_s = motion.times_s();
  auto row = std::upper_bound(rows_s.begin(), rows_s.end(), begin_s);
  for (; row != rows_s.end() && *row <= end_s; ++row) {
    const Pose at[] = {motion.row(static_cast<std::size_t>(row - rows_s.begin()))};
    swept_box_.extend(box_around(at));
  }
}

/// Lets pushed soil and excess load fall. @param rests soil also comes to rest, as it does when the
/// bucket leaves the ground @param ends cuts fail even with the bucket in the ground
void Machine::stop(Ground& ground, double time_s, bool rests, bool ends) {
  if (!placed_) return;
  const Pose& at = current_;
  const Pose here[] = {at};
  if (ledger_.cut() != cut_before_) {
    unsettled_box_.extend(swept_box_);
    unsettled_box_.extend(box_around(here));
  }
  const bool in_air = stays_in_air(ground, here, 0), bank_fails = ends || in_air;
  propped_box_.extend(unsettled_box_);
  let_go();
  if (falling_ > 0 || pushed_ > 0 || !unsettled_box_.isEmpty() ||
      (bank_fails && !propped_box_.isEmpty())) {
    const Obstacle obstacle(bucket_, at, ground);
    if (pushed_ > 0) settler_->drop(push_point(at), std::exchange(pushed_, 0), time_s, obstacle);
    drop_falling(time_s, obstacle);
    if (rests || in_air) {
      const bool done =
          settler_->settle(bank_fails ? propped_box_ : unsettled_box_, obstacle, bank_fails);
      if (done) unsettled_box_.setEmpty();
      if (done && bank_fails) propped_box_.setEmpty();
      stations_ = 0;
    }
    note_leaning(ground, at);
  }
  station_ = at;
  swept_box_ = box_around(here);
  cut_before_ = ledger_.cut();
}

/// Excess load at the present attitude leaves the bucket and is then in flight.
void Machine::let_go() {
  if (!capacity_ || ledger_.load == 0) return;
  const double hold_m3 = capacity_->at(current_.rotation, settler_->slope()).volume_m3;
  const double most = hold_m3 / ledger_.sample_m3 * static_cast<double>(ledger_.units.loose);
  const std::int64_t spill =
      std::max<std::int64_t>(0, ledger_.load - static_cast<std::int64_t>(most));
  ledger_.load -= spill;
  ledger_.spilled += spill;
  falling_ += spill;
}

/// Soil that left the bucket in a turn lands now if it is much, otherwise at the next station.
/// Dense rows thus make as few piles as sparse rows.
void Machine::pass_turn(Ground& ground, double time_s) {
  let_go();
  if (!capacity_ || ledger_.units.loose_samples(falling_) * ledger_.sample_m3 <
                        kMinSpillShare * capacity_->struck_m3())
    return;
  drop_falling(time_s, Obstacle(bucket_, current_, ground));
  note_leaning(ground, current_);
}

void Machine::drop_falling(double time_s, const Obstacle& obstacle) {
  if (falling_ > 0)
    settler_->drop(current_ * spill_point(current_), std::exchange(falling_, 0), time_s, obstacle);
}

/// Soil that leans on the bucket stays until the bucket has gone.
void Machine::note_leaning(const Ground& ground, const Pose& at) {
  const Pose here[] = {at};
  if (!stays_in_air(ground, here, kObstacleClearance * ground.voxel_size_m()))
    unsettled_box_.extend(box_around(here));
}

/// The place where soil leaves the bucket.
Vec3 Machine::spill_point(const Pose& at) const {
  if (capacity_) return capacity_->at(at.rotation, settler_->slope()).spill;
  const Vec3 lip = Vec3::Zero(), upper_edge(0, 0, bucket_.height_m);
  return (at * upper_edge).z() < (at * lip).z() ? upper_edge : lip;
}

/// The place of displaced soil, in front of the body: its point farthest along the way from the
/// last station, or a point before the mouth without movement in plan.
Vec3 Machine::push_point(const Pose& at) const {
  Vec3 way = at.position - station_.position;
  way.z() = 0;
  if (way.norm() < kMinPushWay * radius_m_) way = at.rotation * Vec3::UnitX();
  const auto along = [&](const Vec3& p) { return way.dot(at.rotation * p); };
  // The middles of the faces' edges across the lip: pushed soil is not at a corner.
  const double across = bucket_.shape ? bucket_.shape->box_m().center().y() : 0;
  Vec3 farthest(0, across, 0);
  for (const Vec3& p : extremes_) {
    const Vec3 middle(p.x(), across, p.z());
    if (along(middle) > along(farthest)) farthest = middle;
  }
  return at * farthest;
}

Eigen::AlignedBox3d Machine::box_around(std::span<const Pose> path) const {
  Eigen::AlignedBox3d box;
  for (const Pose& pose : path)
    for (const Vec3& p : extremes_) box.extend(pose * p);
  return box;
}

std::int64_t Machine::slid() const { return settler_ != nullptr ? settler_->totals().slid : 0; }

}  // namespace soilvdb::inline v0
