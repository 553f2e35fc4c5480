// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// When and where the soil that a machine moves comes to rest.
#include <algorithm>
#include <cmath>
#include <limits>
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

double Machine::station_spacing_m(const Ground& ground) const {
  return std::max(kMinStationVoxels * ground.voxel_size_m(), kStationRadiusShare * radius_m_);
}

/// Approximate travel of the bucket's fastest point.
double Machine::travel_m(const Pose& from, const Pose& to) const {
  return (to.position - from.position).norm() + 2 * half_turn(from, to) * radius_m_;
}

/// The stations on the straight way to a pose.
std::vector<Pose> Machine::stations_to(const Ground& ground, const Pose& to) {
  std::vector<Pose> found;
  const double whole_m = travel_m(current_, to), every_m = station_spacing_m(ground);
  for (double at_m = every_m - since_station_m_; at_m <= whole_m; at_m += every_m)
    found.push_back(interpolate(current_, to, at_m / whole_m));
  since_station_m_ = std::fmod(since_station_m_ + whole_m, every_m);
  return found;
}

/// Stations, ends of turns and ticks of a bucket that stands in (begin, end], and the beginnings of
/// standstills in [begin, end). They are counted from row to row, so they do not depend on the
/// updates.
std::vector<Machine::Event> Machine::events(const Ground& ground, const Motion& motion,
                                            double begin_s, double end_s) {
  const double every_m = station_spacing_m(ground);
  const std::vector<double>& rows_s = motion.times_s();
  std::vector<Event> found;
  auto next = std::upper_bound(rows_s.begin(), rows_s.end(), begin_s);
  if (next == rows_s.begin()) ++next;
  for (; next < rows_s.end() && *(next - 1) < end_s; ++next) {
    const auto row = static_cast<std::size_t>(next - rows_s.begin());
    const double from_s = rows_s[row - 1], to_s = rows_s[row];
    const double way_m = travel_m(motion.row(row - 1), motion.row(row));
    if (way_m == 0 && from_s >= begin_s) found.push_back({from_s, Event::Kind::kStandstill});
    double at_m = every_m - since_station_m_;
    for (; at_m <= way_m; at_m += every_m) {
      const double at_s = std::min(to_s, from_s + (to_s - from_s) * (at_m / way_m));
      if (at_s > begin_s && at_s <= end_s) found.push_back({at_s, Event::Kind::kStation});
    }
    if (to_s <= end_s) {
      since_station_m_ = std::max(0.0, every_m - (at_m - way_m));
      const Pose at = motion.row(row);
      const bool goes = travel_m(standing_.at, at) > kMaxTremble_m;
      if (goes) standing_ = {at, to_s, 0};
      if (standing_.since_s > to_s)
        standing_ = {standing_.at, from_s, 0};  // its clock was set back
      const auto ticks = static_cast<std::int64_t>(
          std::min(kMaxStand_s, to_s - standing_.since_s) / kTick_s + kTickRounding);
      if (ticks >= kTicksToStand && ticks > standing_.ticks) {
        const auto due = static_cast<int>(std::min(ticks - standing_.ticks, kMaxTicks));
        found.push_back({to_s, Event::Kind::kTick, due});
        standing_.ticks = ticks;
      }
    }
    if (!capacity_) continue;
    const double turn_rad =  // or a bit more
        std::numbers::pi * half_turn(motion.row(row - 1), motion.row(row));
    const int turns = static_cast<int>(std::ceil(turn_rad / kSpillTurnRad));
    for (int i = 1; i <= turns; ++i) {
      const double at_s = i == turns ? to_s : from_s + (to_s - from_s) * i / turns;
      if (at_s > begin_s && at_s <= end_s) found.push_back({at_s, Event::Kind::kTurn});
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Event& a, const Event& b) { return a.time_s < b.time_s; });
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

/// Lets pushed soil and excess load fall, and soil slide.
void Machine::pass_station(Ground& ground, double time_s, Rest rest) {
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
  const bool heaps = wall_ && rest == Rest::kSome;
  const double before_m = held_m(), before_m3 = heaps ? hold_m3(before_m) : 0;
  // What drops before the mouth holds some of the rest in.
  spill_here(time_s, before_m, heaps ? 1 / (1 + hold_gain_) : 1);
  const std::int64_t dropped = heaps ? pushed_ + in_flight_ : 0;
  drop(ground, time_s, wall_ || rest != Rest::kSome);
  if (rest == Rest::kSome) {
    stations_ = (stations_ + 1) % (kStationsPerRest * kStationsPerSlide);
    // What fails slides from the next station on, as an update must not wait for both.
    const bool fails = (!wall_ || stations_ % kStationsPerRest == 0) && fail();
    if (!fails && (!wall_ || stations_ % kStationsPerSlide == 0))
      settler_->slide(may_slide_, kStationSteps);
  } else {
    const bool banks_fail = rest == Rest::kEnd || !wall_;
    if (wall_) may_slide_.add(obstacle_.cells());
    if (settler_->settle(banks_fail ? propped_box_ : unsettled_box_, banks_fail, may_slide_)) {
      unsettled_box_.setEmpty();
      if (!wall_) propped_box_.setEmpty();
    }
  }
  held_m_ = held_m();
  if (dropped > 0) {
    const double dropped_m3 = ledger_.units.loose_samples(dropped) * ledger_.sample_m3;
    const double gain = (hold_m3(held_m_) - before_m3) / dropped_m3;
    hold_gain_ = (hold_gain_ + std::clamp(gain, 0.0, kMaxHoldGain)) / 2;  // what slides disturbs it
  }
  last_station_ = at;
  swept_box_ = box_around(here);
  cut_before_ = ledger_.cut();
}

/// What hangs falls. Once the bucket has left, a bank that stands too steep fails, when soil that
/// slid before has come to rest: it may lean on the bank. @return whether one failed
bool Machine::fail() {
  if (!unsettled_box_.isEmpty()) settler_->break_overhangs(wall_ ? unsettled_box_ : propped_box_);
  unsettled_box_.setEmpty();
  if (wall_ || propped_box_.isEmpty()) return false;
  settler_->take_changes(may_slide_);
  if (!may_slide_.empty()) return false;
  if (!settler_->fail(propped_box_)) return true;
  propped_box_.setEmpty();
  return false;
}

/// The bucket is a wall to soil where it is in the ground. What leant on it where it was may slide.
void Machine::set_wall(const Ground& ground, const Pose& at, float clearance) {
  const Pose here[] = {at};
  const bool stands = !stays_in_air(ground, here, clearance * ground.voxel_size_m());
  if (wall_ && stands && wall_->position == at.position &&
      wall_->rotation.coeffs() == at.rotation.coeffs())
    return;
  if (wall_) may_slide_.add(obstacle_.cells());
  wall_ = stands ? std::optional(at) : std::nullopt;
  obstacle_ = wall_ ? Obstacle(bucket_, *wall_, ground) : Obstacle();
}

/// What the bucket can hold at the present attitude, with ground before its mouth up to a height
/// above the lip.
double Machine::hold_m3(double held_m) const {
  if (!capacity_) return 0;
  return capacity_->at(current_.rotation, settler_->slope(), held_m).volume_m3;
}

/// The part of the load that is more than that.
std::int64_t Machine::surplus(double held_m) const {
  if (!capacity_ || ledger_.load == 0) return 0;
  const double most =
      hold_m3(held_m) / ledger_.sample_m3 * static_cast<double>(ledger_.units.loose);
  return std::max<std::int64_t>(0, ledger_.load - static_cast<std::int64_t>(most));
}

/// A share of what the bucket can't hold leaves it, and is then in flight.
void Machine::spill(double held_m, double share) {
  const auto mass = static_cast<std::int64_t>(share * static_cast<double>(surplus(held_m)));
  ledger_.load -= mass;
  ledger_.spilled += mass;
  in_flight_ += mass;
}

/// Spills, and keeps from where and when that drops.
void Machine::spill_here(double time_s, double held_m, double share) {
  spill(held_m, share);
  if (in_flight_ == 0 || spilled_from_) return;
  spilled_from_ = current_;
  spilled_s_ = time_s;
}

/// @return mass that slid before
std::int64_t Machine::begin_update() {
  if (settler_ == nullptr) return 0;
  ledger_.load += std::exchange(heaped_, 0);
  return settler_->totals().slid;
}

/// What an update may not leave to the next station. In the ground, what the bucket can't hold goes
/// on before it until then, and holds the load in as the ground there does, or did at the last
/// station: soil must not land at places that depend on the updates.
void Machine::end_update() {
  if (settler_ == nullptr) return;
  settler_->take_changes(may_slide_);
  if (!wall_ && ledger_.cut() == cut_before_) return spill(held_m());
  heaped_ = surplus(std::max(held_m_, held_m()));
  ledger_.load -= heaped_;
}

/// How far up the mouth, from the lip, the ground before it holds the load in; 0 if the rim alone
/// does.
double Machine::held_m() const {
  if (surplus(0) == 0) return 0;
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
  return std::max(held_m / rise, 0.0);
}

/// Dense rows make as few piles as sparse rows.
void Machine::pass_turn(Ground& ground, double time_s) {
  spill_here(time_s, held_m());
  if (!drops_now(ground)) return;
  set_wall(ground, current_);
  drop(ground, time_s, false);
}

/// A bucket that trembles is the wall that it was.
void Machine::stand(const Ground& ground, float clearance) {
  if (!wall_ || travel_m(*wall_, current_) > kMaxTremble_m) set_wall(ground, current_, clearance);
}

void Machine::meet(const Ground& ground, const Vec2& at_m, double reach_m, float clearance) {
  const double from_it_m = (current_.position.head<2>() - at_m).norm();
  if (placed_ && from_it_m < reach_m + radius_m_) stand(ground, clearance);
}

/// What sensors err by is no way, so beside a bucket that stands soil comes to rest by time.
void Machine::pass_tick(Ground& ground, double time_s, int ticks) {
  if (!placed_) return;
  stand(ground, kObstacleClearance);
  spill_here(time_s, held_m());
  drop(ground, time_s, true);
  held_m_ = held_m();
  if (!wall_ && fail()) return;
  settler_->slide(may_slide_, ticks * kStationSteps);
}

/// Does what is in flight drop now? It is much, or left elsewhere than what leaves now.
bool Machine::drops_now(const Ground& ground) const {
  if (in_flight_ == 0) return false;
  return ledger_.units.loose_samples(in_flight_) * ledger_.sample_m3 >=
             kMinSpillShare * capacity_->struck_m3() ||
         apart_m(spill_line(ground, *spilled_from_), spill_line(ground, current_)) >
             station_spacing_m(ground);
}

/// Pushed soil drops, and what is in flight, if it drops now or `all` is to.
void Machine::drop(const Ground& ground, double time_s, bool all) {
  if (pushed_ > 0) {
    const Vec2 way = push_way(current_);
    const Settler::Line line = push_line(current_, way);
    if (spilled_from_ &&
        apart_m(line, spill_line(ground, *spilled_from_)) < ground.voxel_size_m()) {
      in_flight_ += std::exchange(pushed_, 0);
      all = true;
    } else {
      settler_->drop(line, way, std::exchange(pushed_, 0), time_s);
    }
  }
  if (!drops_now(ground) && !(all && in_flight_ > 0)) return;
  const Pose from = *spilled_from_;
  spilled_from_.reset();
  settler_->drop(spill_line(ground, from), (from.rotation * Vec3::UnitX()).head<2>(),
                 std::exchange(in_flight_, 0), spilled_s_);
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
  const Vec2 way = (at.position - last_station_.position).head<2>();
  return way.norm() < kMinPushWay * radius_m_ ? Vec2((at.rotation * Vec3::UnitX()).head<2>()) : way;
}

/// Where displaced soil goes, in front of the body: through its point farthest along the way, along
/// the lip, or along a side that it pushes with.
Settler::Line Machine::push_line(const Pose& at, const Vec2& way) const {
  const auto along = [&](const Vec3& p) { return way.dot((at.rotation * p).head<2>()); };
  Eigen::AlignedBox3d box;
  for (const Vec3& p : extremes_) box.extend(p);
  const double across = box.center().y(), half_m = box.sizes().y() / 2;
  const Vec3 aside = half_m * Vec3::UnitY();
  if (std::abs(along(aside)) > kMaxPushAside * half_m * way.norm()) {
    const double side = across + std::copysign(half_m, along(aside));
    const Vec2 beside(-way.y(), way.x());
    Settler::Line ends;
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const Vec3& p : extremes_) {
      const Vec3 end = at.rotation * Vec3(p.x(), side, p.z());
      const double there = beside.dot(end.head<2>());
      if (there < low) ends[0] = at.position + end;
      if (there > high) ends[1] = at.position + end;
      low = std::min(low, there);
      high = std::max(high, there);
    }
    return ends;
  }
  Vec3 farthest(0, across, 0);
  for (const Vec3& p : extremes_) {
    const Vec3 middle(p.x(), across, p.z());
    if (along(middle) > along(farthest)) farthest = middle;
  }
  return {at * Vec3(farthest - aside), at * Vec3(farthest + aside)};
}

Eigen::AlignedBox3d Machine::box_around(std::span<const Pose> path) const {
  Eigen::AlignedBox3d box;
  for (const Pose& pose : path)
    for (const Vec3& p : extremes_) box.extend(pose * p);
  return box;
}

}  // namespace soilvdb::inline v0
