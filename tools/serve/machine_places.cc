// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/machine_places.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace soilvdb::tools {
namespace {

/// States of a machine: ten seconds of a fast feed.
constexpr std::size_t kMostPlaces = 1024;

}  // namespace

void MachinePlaces::add(std::size_t machine, std::optional<double> time_s, WorkLog::Place at) {
  std::deque<State>& states = states_[machine];
  states.push_back({time_s, std::move(at)});
  if (states.size() > kMostPlaces) states.pop_front();
}

void MachinePlaces::add(const io::JournalUpdate& update) {
  if (update.kind == io::JournalUpdate::Kind::kClock) return set_clock(update.machine);
  if (!update.has_rows() || update.rows.values.empty()) return;
  const io::MotionRows& rows = update.rows;
  add(update.machine, std::isnan(update.end_s) ? std::nullopt : std::optional(update.end_s),
      {{rows.values.end() - static_cast<std::ptrdiff_t>(rows.columns), rows.values.end()},
       rows.joints});
}

void MachinePlaces::set_clock(std::size_t machine) {
  std::deque<State>& states = states_[machine];
  if (states.empty()) return;
  states.erase(states.begin(), states.end() - 1);
  states.back().time_s.reset();
}

const MachinePlaces::State* MachinePlaces::at(std::size_t machine,
                                              std::optional<double> time_s) const {
  const auto found = states_.find(machine);
  if (found == states_.end()) return nullptr;
  const std::deque<State>& states = found->second;
  const auto state = std::find_if(states.rbegin(), states.rend(), [&](const State& one) {
    return !time_s || !one.time_s || *one.time_s <= *time_s;
  });
  return state == states.rend() ? nullptr : &*state;
}

std::optional<double> MachinePlaces::from_s(std::size_t machine) const {
  const auto found = states_.find(machine);
  if (found == states_.end() || found->second.empty()) return {};
  return found->second.front().time_s;
}

std::optional<double> MachinePlaces::latest_s() const {
  std::optional<double> latest_s;
  for (const auto& [machine, states] : states_)
    if (!states.empty()) latest_s = std::max(latest_s, states.back().time_s);
  return latest_s;
}

}  // namespace soilvdb::tools
