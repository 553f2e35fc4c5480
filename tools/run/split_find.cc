// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Finds windows of time and groups of machines whose reaches don't meet in them.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/constants.h"
#include "io/file/text.h"
#include "tools/run/part.h"
#include "tools/run/split_plan.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

constexpr std::size_t kMostWindows = 64;
constexpr double kWithin = 1.1;  // of the shortest time

/// What each machine does in a short time, of about as many updates as the others.
struct Cell {
  double end_s = 0;
  std::vector<io::Box3> reach;
  std::vector<std::int64_t> updates;
};

std::vector<Cell> find_cells(const RunOptions& options, const io::Scenario& scenario,
                             const std::vector<double>& ends_s) {
  const double h = scenario.voxel_size_m;
  Schedule schedule(scenario, options.updates, ends_s, kPathTolerance * h);
  if (!schedule.stops_at().empty())
    throw io::InputError(schedule.stops_at() +
                         "; mend or delete it: only what can be dug to its end can be split");
  const std::size_t machines = scenario.machines.size();
  const auto most = static_cast<std::int64_t>(kMostWindows);
  const std::int64_t room = (schedule.total() + most - 1) / most;
  std::vector<Cell> cells;
  std::int64_t held = room;
  io::Box3 reach;  // of an update so far
  while (const std::optional<Step> step = schedule.next()) {
    const std::size_t m = step->machine;
    reach.extend(reach_of(*step, scenario.machines[m].bucket, h));
    if (!step->ends_update) continue;
    if (held >= room && (cells.empty() || step->end_s > cells.back().end_s)) {
      cells.push_back({0, std::vector<io::Box3>(machines), std::vector<std::int64_t>(machines)});
      held = 0;
    }
    Cell& cell = cells.back();
    cell.end_s = step->end_s;
    cell.reach[m].extend(reach);
    ++cell.updates[m];
    ++held;
    reach.setEmpty();
  }
  return cells;
}

/// Does what one machine does in a window reach to what another does?
bool meet(const std::vector<Cell>& cells, std::size_t a, std::size_t b) {
  io::Box3 whole;
  for (const Cell& cell : cells) whole.extend(cell.reach[b]);
  for (const Cell& cell : cells) {
    if (!cell.reach[a].intersects(whole)) continue;
    for (const Cell& other : cells)
      if (cell.reach[a].intersects(other.reach[b])) return true;
  }
  return false;
}

/// Machines that do something in a window, in groups that don't meet.
std::vector<SplitPlan::Group> groups(const std::vector<Cell>& cells, const io::Scenario& scenario) {
  const std::size_t machines = scenario.machines.size();
  std::vector<std::int64_t> updates(machines);
  for (const Cell& cell : cells)
    for (std::size_t m = 0; m < machines; ++m) updates[m] += cell.updates[m];
  std::vector<std::size_t> group(machines);
  std::iota(group.begin(), group.end(), std::size_t{0});
  for (std::size_t a = 0; a < machines; ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      if (group[a] != group[b] && updates[a] > 0 && updates[b] > 0 && meet(cells, a, b))
        std::replace(group.begin(), group.end(), std::size_t{group[a]}, std::size_t{group[b]});
    }
  }
  std::vector<SplitPlan::Group> all(machines);
  for (std::size_t m = 0; m < machines; ++m) {
    if (updates[m] == 0) continue;
    all[group[m]].machines.push_back(scenario.machines[m].name);
    all[group[m]].updates += updates[m];
  }
  std::erase_if(all, [](const auto& g) { return g.machines.empty(); });
  return all;
}

/// No more groups than `parts`: the largest first, each to what has least yet.
std::vector<SplitPlan::Group> packed(std::vector<SplitPlan::Group> all, std::size_t parts) {
  std::stable_sort(all.begin(), all.end(),
                   [](const auto& a, const auto& b) { return a.updates > b.updates; });
  std::vector<SplitPlan::Group> some(std::min(parts, all.size()));
  for (const SplitPlan::Group& group : all) {
    auto& least = *std::min_element(some.begin(), some.end(), [](const auto& a, const auto& b) {
      return a.updates < b.updates;
    });
    least.updates += group.updates;
    least.machines.insert(least.machines.end(), group.machines.begin(), group.machines.end());
  }
  return some;
}

std::vector<std::vector<Cell>> windows_of(const std::vector<Cell>& cells, std::size_t count) {
  std::vector<std::vector<Cell>> windows(count);
  for (std::size_t i = 0; i < cells.size(); ++i)
    windows[i * count / cells.size()].push_back(cells[i]);
  return windows;
}

/// Which machines meet when, and keep all from going apart.
std::string meetings(const std::vector<Cell>& cells, const io::Scenario& scenario, double begin_s) {
  constexpr std::size_t kMostNamed = 4;
  std::vector<std::string> some;
  std::set<std::pair<std::size_t, std::size_t>> known;
  std::vector<double> begins_s(1, begin_s);
  for (const Cell& cell : cells) begins_s.push_back(cell.end_s);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    for (std::size_t a = 0; a < scenario.machines.size(); ++a) {
      for (std::size_t b = a + 1; b < scenario.machines.size(); ++b) {
        if (cells[i].updates[a] == 0 || cells[i].updates[b] == 0 || !meet({cells[i]}, a, b) ||
            !known.emplace(a, b).second)
          continue;
        some.push_back(fmt::format("{} and {} from {} to {} s",
                                   io::printable(scenario.machines[a].name),
                                   io::printable(scenario.machines[b].name), time_text(begins_s[i]),
                                   time_text(cells[i].end_s)));
      }
    }
  }
  if (some.empty()) return "no two of its machines work at the same time";
  const std::size_t more = some.size() - std::min(some.size(), kMostNamed);
  some.resize(some.size() - more);
  return fmt::format("its machines come to each other's places whenever they work: {}{}",
                     fmt::join(some, ", "), more ? fmt::format(" and {} more pairs", more) : "");
}

void require_apart(const io::Scenario& scenario) {
  const auto refuse = [&](const std::string& why) {
    throw io::InputError(scenario.file, "can't be split: " + why + "; `soilvdb run` digs it");
  };
  if (scenario.soil)
    refuse(
        "it has 'soil:', and what one machine spills or lets slide comes to lie where all may "
        "work");
  if (scenario.machines.size() < 2)
    refuse("it has one machine, and each of its updates goes on from the one before");
}

}  // namespace

SplitPlan make_plan(const RunOptions& options, const io::Scenario& scenario, std::int64_t parts) {
  require_apart(scenario);
  SplitPlan plan;
  plan.options = options;
  plan.parts = parts;
  plan.values = io::scenario_values(scenario.file);
  plan.ends_s = ends_of(scenario.machines);
  const std::vector<Cell> cells = find_cells(options, scenario, plan.ends_s);
  std::vector<SplitPlan> plans;
  for (std::size_t count = 1; count <= std::min(kMostWindows, cells.size()); count *= 2) {
    SplitPlan& one = plans.emplace_back(plan);
    double begin_s = std::numeric_limits<double>::lowest();
    for (const std::vector<Cell>& window : windows_of(cells, count)) {
      const double end_s = window.back().end_s;
      one.windows.push_back(
          {begin_s, end_s, packed(groups(window, scenario), static_cast<std::size_t>(parts))});
      begin_s = end_s;
    }
  }
  const auto shorter = [](const auto& a, const auto& b) { return a.longest() < b.longest(); };
  const auto best =
      static_cast<double>(std::min_element(plans.begin(), plans.end(), shorter)->longest());
  const auto chosen = std::find_if(plans.begin(), plans.end(), [&](const SplitPlan& one) {
    return static_cast<double>(one.longest()) <= kWithin * best;
  });
  if (chosen->longest() == chosen->updates()) {
    double begin_s = scenario.machines.front().motion.begin_s();
    for (const io::MachineInput& m : scenario.machines)
      begin_s = std::min(begin_s, m.motion.begin_s());
    throw io::InputError(scenario.file, fmt::format("can't be split: {}; `soilvdb run` digs it",
                                                    meetings(cells, scenario, begin_s)));
  }
  return *chosen;
}

}  // namespace soilvdb::tools
