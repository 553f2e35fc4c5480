// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// When and where the soil that a machine moves comes to rest.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "core/constants.h"
#include "core/site/machine.h"

namespace soilvdb::inline v0 {
namespace {

/// Sine of half the angle.
double half_turn(const Pose& from, const Pose& to) {
  return (from.rotation.conjugate() * to.rotation).vec().norm();
}

double apart_m(const Settler::Line& a, const Settler::Line& b) {
  return std::max((a[0] - b[0]).norm(), (a[1] - b[1]).norm());
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

/// Stations, ends of turns and ticks of a bucket that stays about where it is in (begin, end], and
/// the beginnings of standstills in [begin, end). They are counted from row to row, so they do not
/// depend on the updates.
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
    if (to_s <= end_s) {
      travel_m_ = std::max(0.0, every_m - (at_m - way_m));
      const Pose at = motion.row(row);
      const bool goes = travel_m(stands_.at, at) > kMaxTremble_m;
      if (goes) stands_ = {at, to_s, 0};
      if (stands_.since_s > to_s) stands_ = {stands_.at, from_s, 0};  // its clock was set back
      const auto ticks = static_cast<std::int64_t>(
          std::min(kMaxStand_s, to_s - stands_.since_s) / kTick_s + kTickRounding);
      if (ticks >= kTicksToStand && ticks > stands_.ticks) {
        const auto due = static_cast<int>(std::min(ticks - stands_.ticks, kMaxTicks));
        found.push_back({to_s, Stop::Kind::kTick, due});
        stands_.ticks = ticks;
      }
    }
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

/// Lets pushed soil and excess load fall, and soil slide: some way at a station, to rest at a
/// standstill, and in the end cuts fail even with the bucket in the ground.
void Machine::stop(Ground& ground, double time_s, Rest rest) {
  if (!placed_) return;
  const Pose& at = current_;
  const Pose here[] = {at};
  if (ledger_.cut() != cut_before_) {
    unsettled_box_.extend(swept_box_);
    unsettled_box_.extend(box_around(here));
  }
  propped_box_.extend(unsettled_box_);
  const bool stood = wall_.has_value();
  set_wall(ground, at);
  if (stood && !wall_) unsettled_box_ = propped_box_;  // the bucket may have held it up
  const bool in_air = !wall_, bank_fails = rest == Rest::kEnds || in_air;
  tip(time_s);
  land(ground, time_s, !in_air || rest != Rest::kSlides);
  if (rest != Rest::kSlides) {
    const Eigen::AlignedBox3d& around = bank_fails ? propped_box_ : unsettled_box_;
    if (settler_->settle(around, bank_fails, unrest_)) {
      stations_ = 0;
      unsettled_box_.setEmpty();
      if (in_air) propped_box_.setEmpty();
    }
  } else {
    ++stations_;
    if (in_air || stations_ >= kStationsPerRest) fail();
    if (in_air || stations_ % kStationsPerSlide == 0) settler_->slide(unrest_, kStationSteps);
  }
  station_ = at;
  swept_box_ = box_around(here);
  cut_before_ = ledger_.cut();
}

/// What hangs falls. Once the bucket has left, a bank that stands too steep fails, when soil that
/// slid before has come to rest: it may lean on the bank.
void Machine::fail() {
  if (!unsettled_box_.isEmpty()) settler_->break_overhangs(wall_ ? unsettled_box_ : propped_box_);
  unsettled_box_.setEmpty();
  stations_ = 0;
  if (wall_ || propped_box_.isEmpty()) return;
  settler_->take_changes(unrest_);
  if (unrest_.empty() && settler_->fail(propped_box_)) propped_box_.setEmpty();
}

/// The bucket is a wall to soil where it is in the ground. What leant on it where it was may slide.
void Machine::set_wall(const Ground& ground, const Pose& at) {
  const Pose here[] = {at};
  const bool stands = !stays_in_air(ground, here, kObstacleClearance * ground.voxel_size_m());
  if (wall_ && stands && wall_->position == at.position &&
      wall_->rotation.coeffs() == at.rotation.coeffs())
    return;
  if (wall_) unrest_.add(obstacle_.cells());
  wall_ = stands ? std::optional(at) : std::nullopt;
  obstacle_ = wall_ ? Obstacle(bucket_, *wall_, ground) : Obstacle();
}

/// The part of the load that the bucket can't hold at the present attitude.
std::int64_t Machine::surplus() {
  if (!capacity_ || ledger_.load == 0) return 0;
  const auto beyond = [&](double held_m) {
    const double hold_m3 = capacity_->at(current_.rotation, settler_->slope(), held_m).volume_m3;
    const double most = hold_m3 / ledger_.sample_m3 * static_cast<double>(ledger_.units.loose);
    return std::max<std::int64_t>(0, ledger_.load - static_cast<std::int64_t>(most));
  };
  return beyond(0) == 0 ? 0 : beyond(held_m());
}

/// What the bucket can't hold leaves it and is then in flight.
void Machine::let_go() {
  const std::int64_t spill = surplus();
  ledger_.load -= spill;
  ledger_.spilled += spill;
  falling_ += spill;
}

/// Lets go at a stop, which says from where and when it falls.
void Machine::tip(double time_s) {
  let_go();
  if (falling_ == 0 || tipped_) return;
  tipped_ = current_;
  tipped_s_ = time_s;
}

/// @return mass that slid before
std::int64_t Machine::begin_update() {
  if (settler_ == nullptr) return 0;
  ledger_.load += std::exchange(heaped_, 0);
  return settler_->totals().slid;
}

/// What an update may not leave to the next station. In the ground, what the bucket can't hold goes
/// on before it until then: soil must not land at places that depend on the updates.
void Machine::end_update() {
  if (settler_ == nullptr) return;
  settler_->take_changes(unrest_);
  if (!wall_ && ledger_.cut() == cut_before_) return let_go();
  heaped_ = surplus();
  ledger_.load -= heaped_;
}

/// How far up the mouth, from the lip, the ground before it holds the load in.
double Machine::held_m() const {
  const Eigen::Matrix3d axes = current_.rotation.toRotationMatrix();
  const double rise = axes(2, 2);  // of the mouth, from the lip to the upper edge
  const Vec2 ahead = axes.col(0).head<2>();
  if (rise < kMinMouthRise || ahead.norm() < kMinMouthRise) return 0;
  const Vec3 half(0, bucket_.width_m / 2, 0);
  const Settler::Line lip = {current_ * Vec3(-half), current_ * half};
  const std::array<double, 2> low = {lip[0].z(), lip[1].z()};
  const std::array<double, 2> high = {low[0] + rise * bucket_.height_m,
                                      low[1] + rise * bucket_.height_m};
  const double low_m = (low[0] + low[1]) / 2;
  // Where the mouth leans over the lip, the ground below it is as it was cut. Not where it looks
  // down: there it is what soil falls onto.
  const double lean = std::clamp(axes.col(2).head<2>().dot(ahead.normalized()) / rise, 0.0, 1.0);
  double held_m = rise * bucket_.height_m;
  for (int n = 0; n < (lean > 0 ? 2 : 1); ++n) {
    Settler::Line before = lip;
    for (Vec3& end : before) end.head<2>() += lean * held_m * ahead.normalized();
    held_m = settler_->mean_height(before, ahead.normalized(), low, high) - low_m;
  }
  return held_m / rise;
}

/// Dense rows make as few piles as sparse rows.
void Machine::pass_turn(Ground& ground, double time_s) {
  tip(time_s);
  if (!lands(ground)) return;
  set_wall(ground, current_);
  land(ground, time_s, false);
}

/// What sensors err by is no way, so beside a bucket that stands soil comes to rest by time.
void Machine::pass_tick(Ground& ground, double time_s, int ticks) {
  if (!placed_) return;
  if (!wall_ || travel_m(*wall_, current_) > kMaxTremble_m) set_wall(ground, current_);
  tip(time_s);
  land(ground, time_s, true);
  if (!wall_) fail();
  settler_->slide(unrest_, ticks * kStationSteps);
}

/// Does soil in the air land now? It is much, or is to land elsewhere than what leaves now.
bool Machine::lands(const Ground& ground) const {
  if (falling_ == 0) return false;
  return ledger_.units.loose_samples(falling_) * ledger_.sample_m3 >=
             kMinSpillShare * capacity_->struck_m3() ||
         apart_m(spill_line(ground, *tipped_), spill_line(ground, current_)) >
             station_travel_m(ground);
}

/// Pushed soil lands, and what is in the air, if it does or `all` is to.
void Machine::land(const Ground& ground, double time_s, bool all) {
  if (pushed_ > 0) {
    const Vec2 way = push_way(current_);
    const Settler::Line line = push_line(current_, way);
    if (tipped_ && apart_m(line, spill_line(ground, *tipped_)) < ground.voxel_size_m()) {
      falling_ += std::exchange(pushed_, 0);
      all = true;
    } else {
      settler_->drop(line, way, std::exchange(pushed_, 0), time_s);
    }
  }
  if (!lands(ground) && !(all && falling_ > 0)) return;
  const Pose from = *tipped_;
  tipped_.reset();
  settler_->drop(spill_line(ground, from), (from.rotation * Vec3::UnitX()).head<2>(),
                 std::exchange(falling_, 0), tipped_s_);
}

/// Where soil leaves the bucket.
Settler::Line Machine::spill_line(const Ground& ground, const Pose& at) const {
  const double half_m = bucket_.width_m / 2;
  Settler::Line line = {Vec3(0, -half_m, 0), Vec3(0, half_m, 0)};  // the lip
  if (capacity_) {
    line = capacity_->spill_line(at.rotation, settler_->slope(), ground.voxel_size_m());
  } else if ((at.rotation * Vec3::UnitZ()).z() < 0) {
    for (Vec3& end : line) end.z() = bucket_.height_m;
  }
  return {at * line[0], at * line[1]};
}

/// The way in plan from the last station, or that before the mouth without movement.
Vec2 Machine::push_way(const Pose& at) const {
  const Vec2 way = (at.position - station_.position).head<2>();
  return way.norm() < kMinPushWay * radius_m_ ? Vec2((at.rotation * Vec3::UnitX()).head<2>()) : way;
}

/// Where displaced soil goes, in front of the body: through its point farthest along the way, along
/// the lip, or at a side that it pushes with.
Settler::Line Machine::push_line(const Pose& at, const Vec2& way) const {
  const auto along = [&](const Vec3& p) { return way.dot((at.rotation * p).head<2>()); };
  Eigen::AlignedBox3d box;
  for (const Vec3& p : extremes_) box.extend(p);
  const double across = box.center().y(), half_m = box.sizes().y() / 2;
  Vec3 farthest(0, across, 0);
  for (const Vec3& p : extremes_) {
    const Vec3 middle(p.x(), across, p.z());
    if (along(middle) > along(farthest)) farthest = middle;
  }
  const Vec3 aside = half_m * Vec3::UnitY();
  if (std::abs(along(aside)) > kMaxPushAside * half_m * way.norm())
    return {at * farthest, at * farthest};
  return {at * Vec3(farthest - aside), at * Vec3(farthest + aside)};
}

Eigen::AlignedBox3d Machine::box_around(std::span<const Pose> path) const {
  Eigen::AlignedBox3d box;
  for (const Pose& pose : path)
    for (const Vec3& p : extremes_) box.extend(pose * p);
  return box;
}

}  // namespace soilvdb::inline v0
