// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/tracker.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>
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

/// Refuses a pose at which a bucket can't be, or whose chunks can't be numbered.
void check_move(const Soil& soil, const Machine& machine, const Pose& pose) {
  const double room_m = kMaxIndex * soil.voxel_size_m() - machine.radius_m();
  std::string what = fault(pose);
  if (what.empty()) what = fault(pose.position, soil.origin(), std::floor(room_m));
  if (!what.empty()) throw std::invalid_argument(what);
}

/// The same for all of a path that its rows say.
void check_move(const Soil& soil, const Machine& machine, const Motion& motion, double begin_s,
                double end_s) {
  if (!std::isfinite(begin_s) || !std::isfinite(end_s) || begin_s > end_s)
    throw std::invalid_argument("the times of an update must be finite and in order");
  const std::vector<double>& times = motion.times_s();
  auto row = static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), begin_s) -
                                      times.begin());
  check_move(soil, machine, motion.pose(begin_s));
  for (; row < times.size() && times[row] < end_s; ++row)
    check_move(soil, machine, motion.row(row));
  check_move(soil, machine, motion.pose(end_s));
}

/// Numbers groups of boxes that are connected by common points. Empty boxes are alone.
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

}  // namespace

Tracker::Tracker(Soil& soil, std::vector<Bucket> buckets)
    : Tracker(soil, std::move(buckets), Earthmoving{}) {}

Tracker::Tracker(Soil& soil, std::vector<Bucket> buckets, Earthmoving earthmoving)
    : soil_(soil), earthmoving_(std::move(earthmoving)), poured_parts_(earthmoving_.pours.size()) {
  earthmoving_.validate();
  if (earthmoving_.soil)
    works_ = std::make_unique<Earthworks>(soil, *earthmoving_.soil, earthmoving_.hoppers);
  for (const Pour& pour : earthmoving_.pours) {
    const double mass =
        pour.volume_m3 / soil.sample_m3() * static_cast<double>(works_->units().loose);
    if (!((pour.at_m - soil.origin()).cwiseAbs().maxCoeff() <=
          kMaxPlaceIndex * soil.voxel_size_m()))
      throw std::invalid_argument("pour '" + pour.name + "': its place is not on this site");
    if (!(mass < 0x1p62))
      throw std::invalid_argument("pour '" + pour.name +
                                  "': its volume is more than can be counted");
  }
  for (Bucket& bucket : buckets)
    machines_.push_back(std::make_unique<Machine>(std::move(bucket), soil, works_.get()));
}

Tracker::Tracker(Soil& clone, const Tracker& other)
    : soil_(clone), earthmoving_(other.earthmoving_), poured_parts_(other.poured_parts_) {
  const Soil& soil = other.soil_;
  if (clone.shared_base() != soil.shared_base() || clone.origin() != soil.origin() ||
      clone.voxel_size_m() != soil.voxel_size_m())
    throw std::invalid_argument("the soil is no clone of the one that the other tracker is on");
  if (other.works_ != nullptr) works_ = std::make_unique<Earthworks>(clone, *other.works_);
  for (const auto& machine : other.machines_)
    machines_.push_back(std::make_unique<Machine>(*machine, works_.get()));
}

Tracker::~Tracker() = default;

Machine& Tracker::at(std::size_t machine) const {
  if (machine >= machines_.size()) throw std::invalid_argument("there is no such machine");
  return *machines_[machine];
}

Update Tracker::update(std::size_t machine, const Pose& world_from_bucket) {
  return timed([&] {
    Machine& m = at(machine);
    check_move(soil_, m, world_from_bucket);
    soil_.page_out();
    return m.move(soil_, world_from_bucket);
  });
}

Update Tracker::update(std::size_t machine, const Motion& motion, double begin_s, double end_s) {
  return timed([&] {
    Machine& m = at(machine);
    check_move(soil_, m, motion, begin_s, end_s);
    soil_.page_out();
    return m.move(soil_, motion, begin_s, end_s);
  });
}

void Tracker::check(const Move& move) const {
  const Machine& machine = at(move.machine);
  if (move.motion != nullptr) {
    check_move(soil_, machine, *move.motion, move.begin_s, move.end_s);
  } else {
    check_move(soil_, machine, move.to);
  }
}

std::optional<BadMove> Tracker::find_bad(std::span<const Move> moves) {
  for (std::size_t i = 0; i < moves.size(); ++i) {
    try {
      check(moves[i]);
    } catch (const std::invalid_argument& e) {
      return BadMove{i, false, e.what()};
    }
  }
  // They go from where they are to where these bring them, and are put back.
  std::vector<std::pair<Machine*, Machine::Place>> before;
  for (const auto& machine : machines_) before.emplace_back(machine.get(), machine->place());
  std::optional<BadMove> bad;
  for (std::size_t i = 0; i < moves.size() && !bad; ++i) {
    const Move& move = moves[i];
    Machine& machine = *machines_[move.machine];
    try {
      if (move.motion != nullptr) {
        machine.require_ground(soil_, *move.motion, move.begin_s, move.end_s);
      } else {
        machine.require_ground(soil_, move.to);
      }
    } catch (const NoGroundError& e) {
      bad = BadMove{i, true, e.what()};
    }
  }
  for (const auto& [machine, place] : before) machine->put_back(place);
  return bad;
}

std::vector<Update> Tracker::update(std::span<const Move> moves) {
  const Clock::time_point begin = Clock::now();
  for (const Move& move : moves) check(move);
  soil_.page_out();
  const std::vector<std::vector<std::size_t>> groups = apart(moves);
  const double planning_us =
      us_since(begin) / static_cast<double>(std::max<std::size_t>(moves.size(), 1));
  std::vector<Update> updates(moves.size());
  const auto run = [&](std::size_t i) {
    const Move& move = moves[i];
    Machine& machine = *machines_[move.machine];
    updates[i] = timed([&] {
      return move.motion != nullptr ? machine.move(soil_, *move.motion, move.begin_s, move.end_s)
                                    : machine.move(soil_, move.to);
    });
    updates[i].us += planning_us;
  };
  tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t g) {
    for (const std::size_t i : groups[g]) run(i);
  });
  return updates;
}

/// Numbers of the moves, in their order, in groups of machines that don't come near each other.
std::vector<std::vector<std::size_t>> Tracker::apart(std::span<const Move> moves) const {
  std::vector<std::vector<std::size_t>> groups(machines_.size());
  // Soil that moves may come from one machine to another.
  if (machines_.size() == 1 || (works_ != nullptr && !machines_.empty())) {
    groups.front().resize(moves.size());
    std::iota(groups.front().begin(), groups.front().end(), std::size_t{0});
    return groups;
  }
  std::vector<std::vector<Pose>> paths(machines_.size());
  for (const Move& move : moves) {
    std::vector<Pose>& path = paths[move.machine];
    if (move.motion == nullptr) {
      path.push_back(move.to);
    } else {
      const Bucket& bucket = machines_[move.machine]->bucket();
      const auto traced = move.motion->trace(move.begin_s, move.end_s, bucket,
                                             kCoarseBend * soil_.voxel_size_m(), kAnyStride);
      path.insert(path.end(), traced.begin(), traced.end());
    }
  }
  std::vector<Eigen::AlignedBox3d> workspaces;
  for (std::size_t m = 0; m < machines_.size(); ++m)
    workspaces.push_back(machines_[m]->workspace(soil_, paths[m]));
  const std::vector<std::size_t> group = groups_of(workspaces);
  for (std::size_t i = 0; i < moves.size(); ++i) groups[group[moves[i].machine]].push_back(i);
  std::erase_if(groups, [](const auto& list) { return list.empty(); });
  return groups;
}

const Ledger& Tracker::ledger(std::size_t machine) const { return machines_.at(machine)->ledger(); }

Ledger Tracker::total() const {
  Ledger sum;
  sum.sample_m3 = soil_.sample_m3();
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

/// The whole of a pour, units of mass.
std::int64_t Tracker::mass_of(const Pour& pour) const {
  return std::llround(pour.volume_m3 / soil_.sample_m3() *
                      static_cast<double>(works_->units().loose));
}

/// What of a pour has come down after so many of its parts.
std::int64_t Tracker::poured(const Pour& pour, std::int64_t parts) const {
  const std::int64_t all = PourParts(pour, soil_.voxel_size_m()).count(), mass = mass_of(pour);
  return mass / all * parts + mass % all * parts / all;
}

Update Tracker::pour(std::size_t pour, double until_s) {
  if (pour >= poured_parts_.size()) throw std::invalid_argument("there is no such pour");
  return timed([&] {
    soil_.page_out();
    const Pour& source = earthmoving_.pours[pour];
    const std::int64_t slid_before = works_->books().slid;
    std::int64_t& parts = poured_parts_[pour];
    const PourParts all(source, soil_.voxel_size_m());
    while (parts < all.count() && all.falls_s(parts + 1) <= until_s) {
      const std::int64_t before = poured(source, parts++);
      works_->drop(source.at_m, poured(source, parts) - before, all.falls_s(parts), Obstacle{});
    }
    Update update;
    update.slid_m3 = slid_m3(slid_before);
    return update;
  });
}

double Tracker::slid_m3(std::int64_t before) const {
  return works_->units().loose_samples(works_->books().slid - before) * soil_.sample_m3();
}

Update Tracker::come_to_rest(std::optional<double> time_s) {
  return timed([&] {
    Update update;
    if (works_ == nullptr) return update;
    const std::int64_t slid_before = works_->books().slid, spilled_before = total().spilled;
    // What one machine leaves may come to lie where another's rested already.
    std::int64_t moved = -1;
    for (int n = 0; n < kMaxRestRounds && moved != works_->books().moved(); ++n) {
      moved = works_->books().moved();
      for (const auto& machine : machines_) machine->come_to_rest(soil_, time_s.value_or(kAnyTime));
    }
    update.slid_m3 = slid_m3(slid_before);
    update.spilled_m3 =
        works_->units().loose_samples(total().spilled - spilled_before) * soil_.sample_m3();
    return update;
  });
}

SiteLedger Tracker::site() const {
  SiteLedger site = booked();
  if (works_ == nullptr) return site;
  for (const Chunk* chunk : soil_.chunks()) {
    site.ground += (std::int64_t{chunk->soil_count} - chunk->loose_count - chunk->base_count) *
                       site.units.bank +
                   chunk->loose_count * site.units.loose;
  }
  return site;
}

SiteLedger Tracker::booked() const {
  SiteLedger site;
  if (works_ == nullptr) return site;
  const Earthworks::Books& books = works_->books();
  site.units = works_->units();
  site.astray = books.astray;
  site.in_flight = books.in_flight + books.astray;
  for (const auto& machine : machines_) site.in_flight += machine->in_flight();
  for (std::size_t i = 0; i < poured_parts_.size(); ++i)
    site.poured += poured(earthmoving_.pours[i], poured_parts_[i]);
  site.hauled = books.hauled;
  site.slid = books.slid;
  site.fill_samples = books.fill_samples;
  site.gone_samples = books.gone_samples;
  return site;
}

double Tracker::tolerance_m() const { return Machine::tolerance_m(soil_); }

std::string Tracker::state() const {
  std::string bytes;
  for (const auto& machine : machines_) machine->save(bytes);
  if (works_ == nullptr) return bytes;
  works_->save(bytes);
  for (const std::int64_t parts : poured_parts_) put(bytes, parts);
  return bytes;
}

void Tracker::restore(std::string_view state) {
  std::vector<std::unique_ptr<Machine>> machines;
  for (const auto& machine : machines_) {
    machines.push_back(std::make_unique<Machine>(machine->bucket(), soil_, works_.get()));
    machines.back()->load(state, soil_);
  }
  Earthworks::Books books;
  std::vector<std::int64_t> parts(poured_parts_.size());
  if (works_ != nullptr) {
    books.load(state);
    for (std::size_t i = 0; i < parts.size(); ++i) {
      take(state, parts[i]);
      if (parts[i] < 0 || parts[i] > PourParts(earthmoving_.pours[i], soil_.voxel_size_m()).count())
        throw std::invalid_argument("the state is of another pour");
    }
  }
  if (!state.empty()) throw std::invalid_argument("the state is of more machines");
  machines_ = std::move(machines);
  poured_parts_ = std::move(parts);
  if (works_ != nullptr) works_->restore(books);
}

}  // namespace soilvdb::inline v0
