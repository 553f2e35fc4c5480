// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A machine's state as bytes and back.
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/site/machine.h"

namespace soilvdb::inline v0 {
namespace {

void require_valid(bool good) {
  if (!good) throw std::invalid_argument("the state has an invalid machine");
}

}  // namespace

void Machine::save(std::string& out) const {
  put(out, bucket_.width_m, bucket_.height_m, std::uint64_t{bucket_.profile.size()});
  put(out, ledger_.captured, ledger_.displaced, ledger_.dumped, placed_, current_);
  if (settler_ == nullptr) return;
  put(out, ledger_.load, ledger_.spilled, since_station_m_);
  put(out, standing_.at, standing_.since_s, standing_.ticks);
  put(out, last_station_, pushed_, in_flight_, heaped_, spilled_s_, cut_before_, stations_, held_m_,
      hold_gain_);
  may_slide_.save(out);
  for (const std::optional<Pose>* pose : {&wall_, &spilled_from_})
    put(out, pose->has_value(), pose->value_or(Pose{}));
  for (const Eigen::AlignedBox3d* box : {&swept_box_, &unsettled_box_, &propped_box_})
    put(out, box->min(), box->max());
}

void Machine::load(std::string_view& in, const Ground& ground) {
  const double room_m = kMaxIndex * ground.voxel_size_m();
  const auto near = [&](const Vec3& p) {
    return (p - ground.origin()).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() <= room_m;
  };
  double width = 0, height = 0;
  std::uint64_t count = 0;
  take(in, width, height, count);
  if (width != bucket_.width_m || height != bucket_.height_m || count != bucket_.profile.size())
    throw std::invalid_argument("the state is of another bucket");
  for (std::int64_t* v : {&ledger_.captured, &ledger_.displaced, &ledger_.dumped})
    take_amount(in, *v);
  take(in, placed_, current_);
  require_valid(is_valid(current_) && (!placed_ || near(current_.position)));
  ledger_.load = ledger_.captured - ledger_.dumped;  // where soil does not move
  if (settler_ == nullptr) return require_valid(ledger_.load >= 0);
  take_amount(in, ledger_.load);
  take_amount(in, ledger_.spilled);
  take(in, since_station_m_, standing_.at, standing_.since_s);
  take_amount(in, standing_.ticks);
  take(in, last_station_);
  for (std::int64_t* v : {&pushed_, &in_flight_, &heaped_}) take_amount(in, *v);
  constexpr std::int64_t kMostMass = std::int64_t{1} << 55;  // sums and products of some
  require_valid(std::max({ledger_.load, pushed_, in_flight_, heaped_}) <= kMostMass);
  take(in, spilled_s_);
  take_amount(in, cut_before_);
  take(in, stations_, held_m_, hold_gain_);
  require_valid(is_valid(standing_.at) && !std::isnan(standing_.since_s) &&
                is_valid(last_station_) && since_station_m_ >= 0 &&
                since_station_m_ <= station_spacing_m(ground) && stations_ >= 0 &&
                stations_ < kStationsPerRest * kStationsPerSlide && held_m_ >= 0 &&
                held_m_ <= 2 * bucket_.height_m && hold_gain_ >= 0 && hold_gain_ <= kMaxHoldGain);
  may_slide_.load(in);
  for (std::optional<Pose>* pose : {&wall_, &spilled_from_}) {
    bool there = false;
    Pose value;
    take(in, there, value);
    require_valid(is_valid(value) && (!there || near(value.position)));
    *pose = there ? std::optional(value) : std::nullopt;
  }
  obstacle_ = wall_ ? Obstacle(bucket_, *wall_, ground) : Obstacle();
  require_valid(!std::isinf(spilled_s_) && (capacity_ || (in_flight_ == 0 && heaped_ == 0)) &&
                (!spilled_from_ || in_flight_ > 0));
  for (Eigen::AlignedBox3d* box : {&swept_box_, &unsettled_box_, &propped_box_}) {
    take(in, box->min(), box->max());
    const bool none = box->min() == Eigen::AlignedBox3d().min() && box->max() == -box->min();
    require_valid(none || (near(box->min()) && near(box->max()) && !box->isEmpty()));
  }
}

}  // namespace soilvdb::inline v0
