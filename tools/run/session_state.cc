// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How a session goes on from state to state.
#include "tools/run/session_state.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <utility>

#include "soilvdb/pour_parts.h"

namespace soilvdb::inline v0 {
Session::State::State(std::vector<SessionMachine> machines_, Earthmoving earthmoving_,
                      io::Site site_)
    : machines(std::move(machines_)),
      earthmoving(std::move(earthmoving_)),
      site(std::move(site_)),
      fed(machines.size()) {
  std::set<std::string> names;
  std::vector<Bucket> buckets;
  for (const SessionMachine& machine : machines) {
    if (!names.insert(machine.name).second)
      throw std::invalid_argument(
          fmt::format("machine '{}' is there twice; names must differ", machine.name));
    buckets.push_back(machine.bucket);
  }
  tracker = std::make_unique<Tracker>(*site.soil, std::move(buckets), earthmoving);
  if (earthmoving.soil) units = MassUnits(*earthmoving.soil);
}

Session::State::State(const State& other)
    : machines(other.machines),
      earthmoving(other.earthmoving),
      site{other.site.soil->clone(), other.site.reference, other.site.crs_wkt, other.site.bounds,
           other.site.beneath},
      tracker(std::make_unique<Tracker>(*site.soil, *other.tracker)),
      units(other.units),
      fed(other.fed),
      poured_s(other.poured_s),
      fed_count(other.fed_count),
      recording(other.recording),
      scenario(other.scenario),
      unmeshed(other.unmeshed) {}

std::string Session::State::name(std::size_t machine) const {
  return fmt::format("machine '{}'", machines[machine].name);
}

/// Tells those who look what changed since they did.
void Session::State::note_changes() {
  const std::vector<Coord3> changed = site.soil->take_touched();
  unmeshed.insert(changed.begin(), changed.end());
  if (unsaved) unsaved->insert(changed.begin(), changed.end());
  if (heights) heights->update(changed);
}

/// The move to a state: along a motion of two rows, as a run's, where times are known.
/// @param last fed to the machine before, then this
/// @param motions keeps those that moves are along
/// @throw std::invalid_argument
Move Session::State::move(const Session& session, const MachineState& state, Fed& last,
                          std::deque<Motion>& motions) const {
  const double time_s = state.time_s;
  if (std::isinf(time_s))
    throw std::invalid_argument(fmt::format("{}: the time must be finite", name(state.machine)));
  if (time_s < last.time_s)
    throw std::invalid_argument(fmt::format("{}: time goes back from {} s to {} s",
                                            name(state.machine), last.time_s, time_s));
  Fed now{time_s, state.pose, {state.joints.begin(), state.joints.end()}};
  if (!now.joints.empty()) now.pose = session.pose(state.machine, state.joints);
  if (const std::string what = fault(now.pose); !what.empty())
    throw std::invalid_argument(name(state.machine) + ": " + what);
  Move move;
  move.machine = state.machine;
  move.to = now.pose;
  if (time_s > last.time_s) {
    const std::vector<double> times_s = {last.time_s, time_s};
    if (!now.joints.empty() && !last.joints.empty()) {
      std::vector<double> rows = last.joints;
      rows.insert(rows.end(), now.joints.begin(), now.joints.end());
      motions.emplace_back(times_s, std::move(rows), *machines[state.machine].chain);
    } else {
      motions.emplace_back(times_s, std::vector<Pose>{last.pose, now.pose});
    }
    move.motion = &motions.back();
    move.begin_s = last.time_s;
    move.end_s = time_s;
  }
  if (std::isnan(time_s)) now.time_s = last.time_s;
  last = std::move(now);
  return move;
}

/// Pours come down in the order of their parts' times.
void Session::State::pour(double until_s) {
  std::vector<double> times_s;
  for (const Pour& pour : earthmoving.pours) {
    const PourParts parts(pour, site.soil->voxel_size_m());
    for (std::int64_t part = 1; part <= parts.count(); ++part)
      if (const double s = parts.falls_s(part); s > poured_s && s <= until_s) times_s.push_back(s);
  }
  std::sort(times_s.begin(), times_s.end());
  times_s.erase(std::unique(times_s.begin(), times_s.end()), times_s.end());
  for (const double time_s : times_s)
    for (std::size_t i = 0; i < earthmoving.pours.size(); ++i) tracker->pour(i, time_s);
  poured_s = std::max(poured_s, until_s);
}

double Session::State::last_s() const {
  double last_s = std::numeric_limits<double>::quiet_NaN();
  for (const Fed& machine : fed) last_s = std::fmax(last_s, machine.time_s);
  return last_s;
}

/// @throw std::invalid_argument if there is none of that number
void Session::State::require(std::size_t machine) const {
  if (machine < machines.size()) return;
  throw std::invalid_argument(fmt::format("there is no machine {}; there are {}, numbered from 0",
                                          machine, machines.size()));
}

std::int64_t Session::State::samples(double m3) const {
  return std::llround(m3 / site.soil->sample_m3());
}

std::int64_t Session::State::mass(double loose_m3) const {
  return std::llround(loose_m3 / site.soil->sample_m3() * static_cast<double>(units.loose));
}

/// Before anything changes. @throw std::runtime_error if it can't be recorded, or its memory can't
/// be kept to the limit
void Session::State::require_room() {
  if (recorder) recorder->check();
  site.soil->page_out();
}

bool Session::State::is_snapshot_due(double time_s) {
  return recorder && recorder->wants_snapshot(time_s);
}

/// After states up to this time.
void Session::State::write_snapshot(double time_s) {
  note_changes();
  std::vector<Coord3> changed;
  if (unsaved) changed.assign(unsaved->begin(), unsaved->end());
  if (unsaved) unsaved->clear();
  io::SnapshotInfo info = snapshot_info();
  info.time_s = time_s;  // pours may have come further than any machine
  info.tracker_state = progress();
  recorder->write_snapshot(changed, site, std::move(info));
}

}  // namespace soilvdb::inline v0
