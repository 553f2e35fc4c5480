// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/tracker.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <mutex>
#include <numeric>
#include <stdexcept>
#include <string>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/site/machine.h"
#include "soilvdb/pour_parts.h"

namespace soilvdb::inline v0 {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kAnyTime = std::numeric_limits<double>::quiet_NaN();  // all hoppers are there

double us_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::micro>(Clock::now() - begin).count();
}

/// Calls `f()`, which gives an update, and times it.
template <typename F>
Update timed(F f) {
  const Clock::time_point begin = Clock::now();
  Update update = f();
  update.us = us_since(begin);
  return update;
}

/// Refuses an invalid pose, and one beyond the indices of chunks.
void check_move(const Ground& ground, const Machine& machine, const Pose& pose) {
  const double room_m = kMaxIndex * ground.voxel_size_m() - machine.radius_m();
  std::string what = validation_error(pose);
  if (what.empty()) what = validation_error(pose.position, ground.origin(), std::floor(room_m));
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

/// Numbers groups of boxes that are connected by overlaps. An empty box is a group of its own.
std::vector<std::size_t> groups_of(const std::vector<Eigen::AlignedBox3d>& boxes) {
  std::vector<std::size_t> group(boxes.size());
  std::iota(group.begin(), group.end(), std::size_t{0});
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (group[i] == group[j] || !boxes[i].intersects(boxes[j])) continue;
      const std::size_t from = group[i], to = group[j];
      std::replace(group.begin(), group.end(), from, to);
    }
  }
  return group;
}

/// Calls `run` for each element of each sequence, on all threads of the arena; the elements of one
/// sequence in their order. A thread continues the sequence with most elements left, so that all
/// sequences end at about the same time.
template <typename F>
void run_sequences(const std::vector<std::vector<std::size_t>>& sequences, const F& run) {
  struct Progress {
    std::size_t next = 0;
    bool is_taken = false;
  };
  std::vector<Progress> all(sequences.size());
  bool failed = false;
  std::mutex mutex;  // for both
  const auto left = [&](std::size_t s) { return sequences[s].size() - all[s].next; };
  const auto take_longest = [&] {
    std::size_t longest = all.size();
    for (std::size_t s = 0; s < all.size(); ++s)
      if (!all[s].is_taken && left(s) > (longest < all.size() ? left(longest) : 0)) longest = s;
    if (longest < all.size()) all[longest].is_taken = true;
    return longest;
  };
  const auto work = [&](std::size_t) {
    std::unique_lock lock(mutex);
    for (std::size_t s = take_longest(); !failed && s < all.size(); s = take_longest()) {
      const std::size_t begin = all[s].next;
      const std::size_t end =
          std::min(sequences[s].size(), begin + 1 + sequences[s].size() / kPartsOfSequence);
      lock.unlock();
      try {
        // While a stroke waits for its parts, the thread must not begin another sequence.
        tbb::this_task_arena::isolate([&] {
          for (std::size_t i = begin; i < end; ++i) run(sequences[s][i]);
        });
      } catch (...) {
        lock.lock();
        failed = true;
        throw;
      }
      lock.lock();
      all[s] = {end, false};
    }
  };
  tbb::parallel_for(std::size_t{0}, sequences.size(), work);
}

}  // namespace

Tracker::Tracker(Ground& ground, std::vector<Bucket> buckets)
    : Tracker(ground, std::move(buckets), Earthmoving{}) {}

Tracker::Tracker(Ground& ground, std::vector<Bucket> buckets, Earthmoving earthmoving)
    : ground_(ground),
      earthmoving_(std::move(earthmoving)),
      poured_parts_(earthmoving_.pours.size()) {
  earthmoving_.validate();
  if (earthmoving_.soil)
    settler_ = std::make_unique<Settler>(ground, *earthmoving_.soil, earthmoving_.hoppers);
  poured_unrest_ = std::make_unique<TileSet>();
  for (const Pour& pour : earthmoving_.pours) {
    const double mass =
        pour.volume_m3 / ground.sample_m3() * static_cast<double>(settler_->units().loose);
    if (!((pour.at_m - ground.origin()).cwiseAbs().maxCoeff() <=
          kMaxPlaceIndex * ground.voxel_size_m()))
      throw std::invalid_argument("pour '" + pour.name + "': its place is not on this site");
    if (!(mass < 0x1p62))
      throw std::invalid_argument("pour '" + pour.name +
                                  "': its volume is more than can be counted");
  }
  for (Bucket& bucket : buckets)
    machines_.push_back(
        std::make_unique<Machine>(machines_.size(), std::move(bucket), ground, settler_.get()));
}

Tracker::Tracker(Ground& clone, const Tracker& other)
    : ground_(clone),
      earthmoving_(other.earthmoving_),
      poured_parts_(other.poured_parts_),
      poured_unrest_(std::make_unique<TileSet>(*other.poured_unrest_)) {
  const Ground& ground = other.ground_;
  if (clone.shared_terrain() != ground.shared_terrain() || clone.origin() != ground.origin() ||
      clone.voxel_size_m() != ground.voxel_size_m())
    throw std::invalid_argument("the ground is not a clone of the other tracker's ground");
  if (other.settler_ != nullptr) settler_ = std::make_unique<Settler>(clone, *other.settler_);
  for (const auto& machine : other.machines_)
    machines_.push_back(std::make_unique<Machine>(*machine, settler_.get()));
}

Tracker::~Tracker() = default;

Machine& Tracker::at(std::size_t machine) const {
  if (machine >= machines_.size()) throw std::invalid_argument("there is no such machine");
  return *machines_[machine];
}

Update Tracker::update(std::size_t machine, const Pose& world_from_bucket) {
  return timed([&] {
    Machine& m = at(machine);
    check_move(ground_, m, world_from_bucket);
    ground_.evict();
    return m.move(ground_, world_from_bucket);
  });
}

Update Tracker::update(std::size_t machine, const Motion& motion, double begin_s, double end_s) {
  return timed([&] {
    Machine& m = at(machine);
    check_move(ground_, m, motion, begin_s, end_s);
    ground_.evict();
    return m.move(ground_, motion, begin_s, end_s);
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

std::vector<Update> Tracker::update(std::span<const Move> moves) {
  const Clock::time_point begin = Clock::now();
  for (const Move& move : moves) check(move);
  ground_.evict();
  const std::vector<std::vector<std::size_t>> groups = apart(moves);
  const double planning_us =
      us_since(begin) / static_cast<double>(std::max<std::size_t>(moves.size(), 1));
  std::vector<Update> updates(moves.size());
  const auto run = [&](std::size_t i) {
    const Move& move = moves[i];
    Machine& machine = *machines_[move.machine];
    updates[i] = timed([&] {
      return move.motion != nullptr ? machine.move(ground_, *move.motion, move.begin_s, move.end_s)
                                    : machine.move(ground_, move.to);
    });
    updates[i].us += planning_us;
  };
  run_sequences(groups, run);
  return updates;
}

/// Indices of the moves, in their order, in groups of machines that stay apart.
std::vector<std::vector<std::size_t>> Tracker::apart(std::span<const Move> moves) const {
  std::vector<std::vector<std::size_t>> groups(machines_.size());
  // Moving soil of one machine may reach another.
  if (machines_.size() == 1 || (settler_ != nullptr && !machines_.empty())) {
    groups.front().resize(moves.size());
    std::iota(groups.front().begin(), groups.front().end(), std::size_t{0});
    return groups;
  }
  std::vector<Eigen::AlignedBox3d> workspaces(machines_.size());
  tbb::parallel_for(std::size_t{0}, machines_.size(), [&](std::size_t m) {
    std::vector<Pose> path;
    for (const Move& move : moves) {
      if (move.machine != m) continue;
      if (move.motion == nullptr) {
        path.push_back(move.to);
      } else {
        const auto traced = move.motion->trace(move.begin_s, move.end_s, machines_[m]->bucket(),
                                               kCoarseBend * ground_.voxel_size_m(), kAnyStride);
        path.insert(path.end(), traced.begin(), traced.end());
      }
    }
    workspaces[m] = machines_[m]->workspace(ground_, path);
  });
  const std::vector<std::size_t> group = groups_of(workspaces);
  for (std::size_t i = 0; i < moves.size(); ++i) groups[group[moves[i].machine]].push_back(i);
  std::erase_if(groups, [](const auto& list) { return list.empty(); });
  return groups;
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
                      static_cast<double>(settler_->units().loose));
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
    const std::int64_t slid_before = settler_->totals().slid;
    std::int64_t& parts = poured_parts_[pour];
    const PourParts all(source, ground_.voxel_size_m());
    while (parts < all.count() && all.falls_s(parts + 1) <= until_s) {
      const std::int64_t before = poured(source, parts++);
      settler_->drop({source.at_m, source.at_m}, Vec2::Zero(), poured(source, parts) - before,
                     all.falls_s(parts));
      settler_->take_changes(*poured_unrest_);
    }
    Update update;
    update.slid_m3 = slid_m3(slid_before);
    return update;
  });
}

double Tracker::slid_m3(std::int64_t before) const {
  return settler_->units().loose_samples(settler_->totals().slid - before) * ground_.sample_m3();
}

Update Tracker::come_to_rest(std::optional<double> time_s) {
  return timed([&] {
    Update update;
    if (settler_ == nullptr) return update;
    const std::int64_t slid_before = settler_->totals().slid, spilled_before = total().spilled;
    // Soil of one machine may land where soil of another is already at rest.
    std::int64_t moved = -1;
    for (int n = 0; n < kMaxRestRounds && moved != settler_->totals().moved(); ++n) {
      moved = settler_->totals().moved();
      settler_->settle({}, false, *poured_unrest_);
      for (const auto& machine : machines_)
        machine->come_to_rest(ground_, time_s.value_or(kAnyTime));
    }
    update.slid_m3 = slid_m3(slid_before);
    update.spilled_m3 =
        settler_->units().loose_samples(total().spilled - spilled_before) * ground_.sample_m3();
    return update;
  });
}

MassBalance Tracker::mass_balance() const {
  MassBalance balance = mass_balance_without_ground();
  if (settler_ == nullptr) return balance;
  for (const Chunk* chunk : ground_.chunks()) {
    balance.ground += (std::int64_t{chunk->soil_count} - chunk->loose_count - chunk->base_count) *
                          balance.units.bank +
                      chunk->loose_count * balance.units.loose;
  }
  return balance;
}

MassBalance Tracker::mass_balance_without_ground() const {
  MassBalance balance;
  if (settler_ == nullptr) return balance;
  const Settler::SettleTotals& totals = settler_->totals();
  balance.units = settler_->units();
  balance.lost_off_terrain = totals.lost_off_terrain;
  balance.pending = totals.pending + totals.lost_off_terrain;
  for (const auto& machine : machines_) balance.pending += machine->pending();
  for (std::size_t i = 0; i < poured_parts_.size(); ++i)
    balance.poured += poured(earthmoving_.pours[i], poured_parts_[i]);
  balance.hauled = totals.hauled;
  balance.slid = totals.slid;
  balance.fill_samples = totals.fill_samples;
  balance.failed_samples = totals.failed_samples;
  return balance;
}

double Tracker::tolerance_m() const { return Machine::tolerance_m(ground_); }

std::string Tracker::state() const {
  std::string bytes;
  for (const auto& machine : machines_) machine->save(bytes);
  if (settler_ == nullptr) return bytes;
  settler_->save(bytes);
  poured_unrest_->save(bytes);
  for (const std::int64_t parts : poured_parts_) put(bytes, parts);
  return bytes;
}

void Tracker::restore(std::string_view state) {
  std::vector<std::unique_ptr<Machine>> machines;
  for (const auto& machine : machines_) {
    machines.push_back(
        std::make_unique<Machine>(machines.size(), machine->bucket(), ground_, settler_.get()));
    machines.back()->load(state, ground_);
  }
  Settler::SettleTotals totals;
  TileSet unrest;
  std::vector<std::int64_t> parts(poured_parts_.size());
  if (settler_ != nullptr) {
    totals.load(state);
    unrest.load(state);
    for (std::size_t i = 0; i < parts.size(); ++i) {
      take(state, parts[i]);
      if (parts[i] < 0 ||
          parts[i] > PourParts(earthmoving_.pours[i], ground_.voxel_size_m()).count())
        throw std::invalid_argument("the state is of another pour");
    }
  }
  if (!state.empty()) throw std::invalid_argument("the state is of more machines");
  machines_ = std::move(machines);
  poured_parts_ = std::move(parts);
  if (settler_ == nullptr) return;
  settler_->restore(totals);
  *poured_unrest_ = unrest;
  for (const auto& machine : machines_) machine->raise_wall(ground_);
}

}  // namespace soilvdb::inline v0
