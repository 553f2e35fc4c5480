// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/tracker.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/site/machine.h"
#include "core/site/timed.h"
#include "core/survey/surveyed_samples.h"
#include "soilvdb/pour_parts.h"

namespace soilvdb::inline v0 {
namespace {

constexpr double kAnyTime = std::numeric_limits<double>::quiet_NaN();  // all hoppers are there

/// Why a pose is refused: it is invalid, or beyond the indices of chunks; empty: it is not.
std::string pose_error(const Ground& ground, const Machine& machine, const Pose& pose) {
  const double room_m = kMaxIndex * ground.voxel_size_m() - machine.radius_m();
  std::string what = validation_error(pose);
  if (what.empty()) what = validation_error(pose.position, ground.origin(), std::floor(room_m));
  return what;
}

void check_move(const Ground& ground, const Machine& machine, const Pose& pose) {
  const std::string what = pose_error(ground, machine, pose);
  if (!what.empty()) throw std::invalid_argument(what);
}

/// The same for the ends of a part of a motion and its rows.
void check_move(const Ground& ground, const Machine& machine, const Motion& motion, double begin_s,
                double end_s) {
  if (!std::isfinite(begin_s) || !std::isfinite(end_s) || begin_s > end_s)
    throw std::invalid_argument("the times of an update must be finite and in order");
  const std::vector<double>& times = motion.times_s();
  auto row = static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), begin_s) -
                                      times.begin());
  check_move(ground, machine, motion.pose(begin_s));
  for (; row < times.size() && times[row] < end_s; ++row)
    check_move(ground, machine, motion.row(row));
  check_move(ground, machine, motion.pose(end_s));
}

}  // namespace

Tracker::Tracker(Ground& ground, std::vector<Bucket> buckets)
    : Tracker(ground, std::move(buckets), Earthmoving{}) {}

Tracker::Tracker(Ground& ground, std::vector<Bucket> buckets, Earthmoving earthmoving)
    : ground_(ground),
      earthmoving_(std::move(earthmoving)),
      poured_parts_(earthmoving_.pours.size()) {
  earthmoving_.validate();
  if (earthmoving_.soil) {
    auto pourer = std::make_unique<Settler>(ground, *earthmoving_.soil, earthmoving_.hoppers);
    for (std::size_t m = 0; m < buckets.size(); ++m)
      settlers_.push_back(std::make_unique<Settler>(ground, *pourer));
    settlers_.push_back(std::move(pourer));
  }
  pours_may_slide_ = std::make_unique<TileSet>();
  surveyed_samples_ = std::make_shared<SurveyedSamples>();
  for (const Pour& pour : earthmoving_.pours) {
    const double mass =
        pour.volume_m3 / ground.sample_m3() * static_cast<double>(settlers_.back()->units().loose);
    if (!((pour.at_m - ground.origin()).cwiseAbs().maxCoeff() <=
          kMaxPlaceIndex * ground.voxel_size_m()))
      throw std::invalid_argument("pour '" + pour.name + "': its place is not on this site");
    if (!(mass < 0x1p62))
      throw std::invalid_argument("pour '" + pour.name +
                                  "': its volume is more than can be counted");
  }
  for (Bucket& bucket : buckets)
    machines_.push_back(
        std::make_unique<Machine>(std::move(bucket), ground, settler(machines_.size())));
  raise_walls();
}

Tracker::Tracker(Ground& clone, const Tracker& other)
    : ground_(clone),
      earthmoving_(other.earthmoving_),
      poured_parts_(other.poured_parts_),
      surveyed_(other.surveyed_),
      surveyed_samples_(other.surveyed_samples_),
      pours_may_slide_(std::make_unique<TileSet>(*other.pours_may_slide_)) {
  const Ground& ground = other.ground_;
  if (clone.shared_terrain() != ground.shared_terrain() || clone.origin() != ground.origin() ||
      clone.voxel_size_m() != ground.voxel_size_m())
    throw std::invalid_argument("the ground is not a clone of the other tracker's ground");
  for (const auto& settler : other.settlers_)
    settlers_.push_back(std::make_unique<Settler>(clone, *settler));
  for (const auto& machine : other.machines_)
    machines_.push_back(std::make_unique<Machine>(*machine, settler(machines_.size())));
  raise_walls();
}

Tracker::~Tracker() = default;

Settler* Tracker::settler(std::size_t machine) const {
  return moves_soil() ? settlers_[machine].get() : nullptr;
}

/// Where one changed the ground, nothing may slide for the others. What none of them changed is for
/// the next.
void Tracker::others_forget_changes(std::size_t settler) {
  for (std::size_t i = 0; i < settlers_.size(); ++i)
    if (i != settler) settlers_[i]->forget_changes();
}

/// Each tool is a wall to the soil of all.
void Tracker::raise_walls() {
  std::vector<const Obstacle*> walls;
  for (const auto& machine : machines_) walls.push_back(&machine->wall());
  for (const auto& settler : settlers_) settler->set_walls(walls);
}

Machine& Tracker::at(std::size_t machine) const {
  if (machine >= machines_.size()) throw std::invalid_argument("there is no such machine");
  return *machines_[machine];
}

Update Tracker::update(std::size_t machine, const Pose& world_from_bucket) {
  return timed([&] {
    Machine& m = at(machine);
    check_move(ground_, m, world_from_bucket);
    ground_.evict();
    const Update update = m.move(ground_, world_from_bucket);
    others_forget_changes(machine);
    return update;
  });
}

Update Tracker::update(std::size_t machine, const Motion& motion, double begin_s, double end_s) {
  return timed([&] {
    Machine& m = at(machine);
    check_move(ground_, m, motion, begin_s, end_s);
    ground_.evict();
    const Update update = m.move(ground_, motion, begin_s, end_s);
    others_forget_changes(machine);
    return update;
  });
}

std::string Tracker::misplaced(std::size_t machine, const Pose& world_from_bucket) const {
  const Machine& m = at(machine);
  std::string what = pose_error(ground_, m, world_from_bucket);
  return what.empty() ? m.misplaced(ground_, world_from_bucket) : what;
}

Update Tracker::place(std::size_t machine, const Pose& world_from_bucket,
                      std::optional<double> time_s) {
  return timed([&] {
    Machine& m = at(machine);
    check_move(ground_, m, world_from_bucket);
    ground_.evict();
    const Update update = m.place(ground_, world_from_bucket, time_s.value_or(kAnyTime));
    others_forget_changes(machine);
    return update;
  });
}

void Tracker::check(const Move& move) const {
  const Machine& machine = at(move.machine);
  if (move.motion != nullptr) {
    check_move(ground_, machine, *move.motion, move.begin_s, move.end_s);
  } else {
    check_move(ground_, machine, move.to);
  }
}

std::optional<InvalidMove> Tracker::first_invalid(std::span<const Move> moves) {
  for (std::size_t i = 0; i < moves.size(); ++i) {
    try {
      check(moves[i]);
    } catch (const std::invalid_argument& e) {
      return InvalidMove{i, false, e.what()};
    }
  }
  // The machines make their moves without digging, and are set back.
  std::vector<std::pair<Machine*, Machine::KinematicState>> before;
  for (const auto& machine : machines_)
    before.emplace_back(machine.get(), machine->kinematic_state());
  std::optional<InvalidMove> invalid;
  for (std::size_t i = 0; i < moves.size() && !invalid; ++i) {
    const Move& move = moves[i];
    Machine& machine = *machines_[move.machine];
    try {
      if (move.motion != nullptr) {
        machine.require_ground(ground_, *move.motion, move.begin_s, move.end_s);
      } else {
        machine.require_ground(ground_, move.to);
      }
    } catch (const NoGroundError& e) {
      invalid = InvalidMove{i, true, e.what()};
    }
  }
  for (const auto& [machine, state] : before) machine->restore(state);
  return invalid;
}

const Ledger& Tracker::ledger(std::size_t machine) const { return machines_.at(machine)->ledger(); }

Ledger Tracker::total() const {
  Ledger sum;
  sum.sample_m3 = ground_.sample_m3();
  for (const auto& machine : machines_) {
    sum.captured += machine->ledger().captured;
    sum.displaced += machine->ledger().displaced;
    sum.load += machine->ledger().load;
    sum.spilled += machine->ledger().spilled;
    sum.dumped += machine->ledger().dumped;
    sum.units = machine->ledger().units;
  }
  return sum;
}

/// The mass of a whole pour, units of mass.
std::int64_t Tracker::mass_of(const Pour& pour) const {
  return std::llround(pour.volume_m3 / ground_.sample_m3() *
                      static_cast<double>(settlers_.back()->units().loose));
}

/// The mass of the first `parts` parts of a pour.
std::int64_t Tracker::poured(const Pour& pour, std::int64_t parts) const {
  const std::int64_t all = PourParts(pour, ground_.voxel_size_m()).count(), mass = mass_of(pour);
  return mass / all * parts + mass % all * parts / all;
}

Update Tracker::pour(std::size_t pour, double until_s) {
  if (pour >= poured_parts_.size()) throw std::invalid_argument("there is no such pour");
  return timed([&] {
    ground_.evict();
    const Pour& source = earthmoving_.pours[pour];
    Settler& settler = *settlers_.back();
    const std::int64_t slid_before = settler.totals().slid;
    std::int64_t& parts = poured_parts_[pour];
    const PourParts all(source, ground_.voxel_size_m());
    while (parts < all.count() && all.falls_s(parts + 1) <= until_s) {
      const std::int64_t before = poured(source, parts++), mass = poured(source, parts) - before;
      const float clearance = settler.clearance(mass);
      const double reach_m = settler.reach_m(source.at_m, clearance);
      for (const auto& machine : machines_)
        machine->meet(ground_, source.at_m.head<2>(), reach_m, clearance);
      settler.drop({source.at_m, source.at_m}, Vec2::Zero(), mass, all.falls_s(parts), clearance);
    }
    settler.take_changes(*pours_may_slide_);
    others_forget_changes(machines_.size());
    Update update;
    update.slid_m3 =
        settler.units().loose_samples(settler.totals().slid - slid_before) * ground_.sample_m3();
    return update;
  });
}

Update Tracker::come_to_rest(std::optional<double> time_s) {
  return timed([&] {
    Update update;
    if (!moves_soil()) return update;
    const std::int64_t slid_before = settled().slid, spilled_before = total().spilled;
    // Soil of one machine may land where soil of another is already at rest.
    std::int64_t moved = -1;
    for (int n = 0; n < kMaxRestRounds && moved != settled().moved(); ++n) {
      moved = settled().moved();
      settlers_.back()->settle({}, false, *pours_may_slide_);
      others_forget_changes(machines_.size());
      for (std::size_t m = 0; m < machines_.size(); ++m) {
        machines_[m]->come_to_rest(ground_, time_s.value_or(kAnyTime));
        others_forget_changes(m);
      }
    }
    const MassUnits& units = settlers_.back()->units();
    update.slid_m3 = units.loose_samples(settled().slid - slid_before) * ground_.sample_m3();
    update.spilled_m3 = units.loose_samples(total().spilled - spilled_before) * ground_.sample_m3();
    return update;
  });
}

SettleTotals Tracker::settled() const {
  SettleTotals sum;
  for (const auto& settler : settlers_) sum += settler->totals();
  return sum;
}

MassBalance Tracker::mass_balance() const {
  MassBalance balance = mass_balance_without_ground();
  if (!moves_soil()) return balance;
  for (const Chunk* chunk : ground_.chunks()) {
    balance.ground += (std::int64_t{chunk->soil_count} - chunk->loose_count - chunk->base_count) *
                          balance.units.bank +
                      chunk->loose_count * balance.units.loose;
  }
  return balance;
}

MassBalance Tracker::mass_balance_without_ground() const {
  MassBalance balance;
  if (!moves_soil()) return balance;
  const SettleTotals totals = settled();
  balance.units = settlers_.back()->units();
  balance.lost_off_terrain = totals.lost_off_terrain;
  balance.pending = totals.pending + totals.lost_off_terrain;
  for (const auto& machine : machines_) balance.pending += machine->pending();
  for (std::size_t i = 0; i < poured_parts_.size(); ++i)
    balance.poured += poured(earthmoving_.pours[i], poured_parts_[i]);
  balance.hauled = totals.hauled;
  balance.slid = totals.slid;
  balance.fill_samples = totals.fill_samples;
  balance.failed_samples = totals.failed_samples;
  balance.surveyed = surveyed_.mass;
  return balance;
}

double Tracker::tolerance_m() const { return Machine::tolerance_m(ground_); }

std::string Tracker::state() const {
  std::string bytes;
  for (const auto& machine : machines_) machine->save(bytes);
  if (moves_soil()) {
    for (const auto& settler : settlers_) settler->save(bytes);
    pours_may_slide_->save(bytes);
    for (const std::int64_t parts : poured_parts_) put(bytes, parts);
  }
  put(bytes, surveyed_.removed, surveyed_.added, surveyed_.mass);
  if (surveyed_.removed > 0 || surveyed_.added > 0) surveyed_samples_->save(bytes);
  return bytes;
}

void Tracker::restore(std::string_view state) { restore(state, machines_.size()); }

void Tracker::restore(std::string_view state, std::size_t count) {
  std::vector<std::string_view> machines;
  for (std::size_t m = 0; m < count; ++m) {
    machines.push_back(state);
    Machine(machines_[m]->bucket(), ground_, settler(m)).load(state, ground_);  // is it good?
  }
  std::vector<SettleTotals> totals(settlers_.size());
  TileSet may_slide;
  std::vector<std::int64_t> parts(poured_parts_.size());
  if (moves_soil()) {
    for (std::size_t i = 0; i < totals.size(); ++i)
      if (i < count || i + 1 == totals.size()) totals[i].load(state, settlers_.size());
    may_slide.load(state);
    for (std::size_t i = 0; i < parts.size(); ++i) {
      take(state, parts[i]);
      if (parts[i] < 0 ||
          parts[i] > PourParts(earthmoving_.pours[i], ground_.voxel_size_m()).count())
        throw std::invalid_argument("the state is of another pour");
    }
  }
  Surveyed surveyed;
  take_amount(state, surveyed.removed);
  take_amount(state, surveyed.added);
  take(state, surveyed.mass);
  SurveyedSamples samples;
  if (surveyed.removed > 0 || surveyed.added > 0) samples = SurveyedSamples::load(state);
  if (!state.empty()) throw std::invalid_argument("the state is of more machines");
  for (std::size_t m = 0; m < count; ++m) machines_[m]->load(machines[m], ground_);
  poured_parts_ = std::move(parts);
  for (std::size_t i = 0; i < settlers_.size(); ++i) settlers_[i]->restore(totals[i]);
  *pours_may_slide_ = may_slide;
  surveyed_ = surveyed;
  surveyed_samples_ = std::make_shared<SurveyedSamples>(std::move(samples));
}

}  // namespace soilvdb::inline v0
