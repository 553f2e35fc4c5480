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

namespace soilvdb::inline v0 {
void Session::State::become(SiteState&& other) {
  note_changes();
  for (const Chunk* chunk : site.soil->chunks()) unmeshed.insert(chunk->origin);
  SiteState::operator=(std::move(other));
  site.soil->take_touched();
  for (const Chunk* chunk : site.soil->chunks()) unmeshed.insert(chunk->origin);
  heights.reset();
  limit_memory();
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

/// @throw std::invalid_argument if there is none of that number
void Session::State::require(std::size_t machine) const {
  if (machine < machines.size()) return;
  throw std::invalid_argument(fmt::format("there is no machine {}; there are {}, numbered from 0",
                                          machine, machines.size()));
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
  recorder->write_snapshot(changed, site, snapshot_info(time_s));
}

}  // namespace soilvdb::inline v0
