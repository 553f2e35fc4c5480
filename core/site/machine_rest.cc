// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a machine leaves to come to rest, and when.
#include <algorithm>
#include <cmath>

#include "core/constants.h"
#include "core/site/machine.h"

namespace soilvdb::inline v0 {

double Machine::station_travel_m(const Soil& soil) const {
  return std::max(kStationVoxels * soil.voxel_size_m(), kStationShare * radius_m_);
}

/// About how far the fastest point of the bucket goes.
double Machine::travel_m(const Pose& from, const Pose& to) const {
  const double half_turn = (from.rotation.conjugate() * to.rotation).vec().norm();
  return (to.position - from.position).norm() + 2 * half_turn * radius_m_;
}

/// Times of the stations in (begin, end], and where the bucket comes to a standstill. They are
/// places between rows: other updates have the same.
std::vector<double> Machine::stations(const Soil& soil, const Motion& motion, double begin_s,
                                      double end_s) {
  const double every_m = station_travel_m(soil);
  const std::vector<double>& rows_s = motion.times_s();
  std::vector<double> found;
  auto next = std::upper_bound(rows_s.begin(), rows_s.end(), begin_s);
  for (double at_s = begin_s; at_s < end_s && next != rows_s.end(); ++next) {
    if (next == rows_s.begin()) continue;
    const auto row = static_cast<std::size_t>(next - rows_s.begin());
    const double until_s = std::min(*next, end_s);
    const double m_per_s =
        travel_m(motion.row(row - 1), motion.row(row)) / (rows_s[row] - rows_s[row - 1]);
    if (m_per_s == 0) {
      found.push_back(at_s);
    } else {
      while (travel_m_ + m_per_s * (until_s - at_s) >= every_m) {
        at_s = std::min(until_s, at_s + (every_m - travel_m_) / m_per_s);
        travel_m_ = 0;
        found.push_back(at_s);
      }
      travel_m_ += m_per_s * (until_s - at_s);
    }
    at_s = until_s;
  }
  return found;
}

void Machine::come_to_rest(Soil& soil, double time_s) {
  if (!placed_) return;
  const Pose& at = current_;
  std::int64_t spill = 0;
  Hold hold;
  if (capacity_ && ledger_.load > 0) {
    hold = capacity_->at(at.rotation, works_->slope());
    const double most =
        hold.volume_m3 / ledger_.sample_m3 * static_cast<double>(ledger_.units.loose);
    spill = std::max<std::int64_t>(0, ledger_.load - static_cast<std::int64_t>(most));
  }
  if (spill > 0 || pushed_ > 0 || !unsettled_m_.isEmpty()) {
    const Obstacle obstacle(bucket_, at, soil);
    if (pushed_ > 0) works_->drop(push_point(at), std::exchange(pushed_, 0), time_s, obstacle);
    if (spill > 0) {
      ledger_.load -= spill;
      ledger_.spilled += spill;
      works_->drop(at * hold.spill, spill, time_s, obstacle);
    }
    works_->settle(unsettled_m_, obstacle);
    // Soil that leans on the bucket does so until that has gone.
    unsettled_m_.setEmpty();
    const Pose here[] = {at};
    if (!stays_in_air(soil, here, 0)) unsettled_m_ = plan_box(here);
  }
  station_ = at;
}

/// Where soil leaves the bucket.
Vec3 Machine::spill_point(const Pose& at) const {
  if (capacity_) return capacity_->at(at.rotation, works_->slope()).spill;
  const Vec3 lip = Vec3::Zero(), upper_edge(0, 0, bucket_.height_m);
  return (at * upper_edge).z() < (at * lip).z() ? upper_edge : lip;
}

/// What the body displaces is before it: at the point that is farthest on its way from the last
/// station, or before the mouth if it didn't go anywhere in plan.
Vec3 Machine::push_point(const Pose& at) const {
  Vec3 way = at.position - station_.position;
  way.z() = 0;
  if (way.norm() < kLeastPush * radius_m_) way = at.rotation * Vec3::UnitX();
  const auto along = [&](const Vec3& p) { return way.dot(at.rotation * p); };
  // The middles of the faces' edges across the lip: what is pushed isn't at a corner.
  Vec3 farthest = Vec3::Zero();
  for (const Vec3& p : extremes_) {
    const Vec3 middle(p.x(), 0, p.z());
    if (along(middle) > along(farthest)) farthest = middle;
  }
  return at * farthest;
}

Eigen::AlignedBox2d Machine::plan_box(std::span<const Pose> path) const {
  Eigen::AlignedBox2d box;
  for (const Pose& pose : path)
    for (const Vec3& p : extremes_) box.extend((pose * p).head<2>().eval());
  return box;
}

std::int64_t Machine::slid() const { return works_ != nullptr ? works_->books().slid : 0; }

}  // namespace soilvdb::inline v0
