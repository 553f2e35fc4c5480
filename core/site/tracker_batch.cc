// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Moves of many machines: at once where the machines are apart, with the result of one after
// another. Soil may move farther than its machine. So each group of machines is given columns, and
// soil that would leave them ends the attempt: all is set back, and the moves are made in turn.
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <numeric>

#include "core/constants.h"
#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "core/site/machine.h"
#include "core/site/timed.h"
#include "soilvdb/tracker.h"

namespace soilvdb::inline v0 {

/// Machines near each other, and their moves in order.
struct Tracker::Group {
  std::vector<std::size_t> machines, moves;
  Eigen::AlignedBox2i cells;  // columns that only they look at and change
};

namespace {

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

/// The same, where each group has one box around all of its own, which becomes that of each.
std::vector<std::size_t> groups_of_unions(std::vector<Eigen::AlignedBox3d>& boxes) {
  std::vector<std::size_t> group = groups_of(boxes);
  for (std::vector<std::size_t> before; before != group; group = groups_of(boxes)) {
    before = group;
    std::vector<Eigen::AlignedBox3d> all(boxes.size());
    for (std::size_t i = 0; i < boxes.size(); ++i) all[group[i]].extend(boxes[i]);
    for (std::size_t i = 0; i < boxes.size(); ++i) boxes[i] = all[group[i]];
  }
  return group;
}

/// The whole tiles in a box in plan that grows by half of the way to the nearest of others.
Eigen::AlignedBox2i tiles_of(std::size_t at, const std::vector<Eigen::AlignedBox3d>& boxes) {
  const Eigen::AlignedBox3d& box = boxes[at];
  double room = kMaxIndex;
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    if (i == at || boxes[i].isEmpty()) continue;
    const Vec3 gap = (boxes[i].min() - box.max()).cwiseMax(box.min() - boxes[i].max());
    room = std::min(room, gap.head<2>().maxCoeff() / 2);
  }
  const Vec2 low = (box.min().head<2>().array() - room) / kChunkSide;
  const Vec2 end = (box.max().head<2>().array() + room) / kChunkSide;
  return {kChunkSide * low.array().ceil().matrix().cast<int>(),
          kChunkSide * end.array().floor().matrix().cast<int>() - Coord2::Ones()};
}

/// Calls `run` for each move of each group, on all threads of the arena; the moves of one group in
/// their order. A thread continues the group with most moves left, so that all groups end at about
/// the same time.
template <typename Groups, typename F>
void run_sequences(const Groups& groups, const F& run) {
  struct Progress {
    std::size_t next = 0;
    bool is_taken = false;
  };
  std::vector<Progress> all(groups.size());
  bool failed = false;
  std::mutex mutex;  // for both
  const auto left = [&](std::size_t g) { return groups[g].moves.size() - all[g].next; };
  const auto take_longest = [&] {
    std::size_t longest = all.size();
    for (std::size_t g = 0; g < all.size(); ++g)
      if (!all[g].is_taken && left(g) > (longest < all.size() ? left(longest) : 0)) longest = g;
    if (longest < all.size()) all[longest].is_taken = true;
    return longest;
  };
  const auto work = [&](std::size_t) {
    std::unique_lock lock(mutex);
    for (std::size_t g = take_longest(); !failed && g < all.size(); g = take_longest()) {
      const std::vector<std::size_t>& moves = groups[g].moves;
      const std::size_t begin = all[g].next;
      const std::size_t end = std::min(moves.size(), begin + 1 + moves.size() / kPartsOfSequence);
      lock.unlock();
      try {
        // While a stroke waits for its parts, the thread must not begin another group's.
        tbb::this_task_arena::isolate([&] {
          for (std::size_t i = begin; i < end; ++i) run(moves[i]);
        });
      } catch (...) {
        lock.lock();
        failed = true;
        throw;
      }
      lock.lock();
      all[g] = {end, false};
    }
  };
  tbb::parallel_for(std::size_t{0}, groups.size(), work);
}

}  // namespace

std::vector<Update> Tracker::update(std::span<const Move> moves) {
  const auto begin = std::chrono::steady_clock::now();
  for (const Move& move : moves) check(move);
  ground_.evict();
  const std::vector<Group> groups = apart(moves);
  const auto share_us = [&] {
    return us_since(begin) / static_cast<double>(std::max<std::size_t>(moves.size(), 1));
  };
  double planning_us = share_us();
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
  if (!moves_soil()) {
    run_sequences(groups, run);
  } else if (groups.size() < 2 || settlers_.back()->has_changes() || !may_run_apart() ||
             !run_apart(groups, moves, run)) {
    planning_us = share_us();
    for (std::size_t i = 0; i < moves.size(); ++i) {
      run(i);
      others_forget_changes(moves[i].machine);
    }
  }
  return updates;
}

/// Where soil left its columns, it will soon do so again. So some batches are made in turn then.
bool Tracker::may_run_apart() {
  if (in_turn_ == 0) return true;
  --in_turn_;
  return false;
}

/// @return false if soil of one group might have met that of another; then nothing has happened
bool Tracker::run_apart(std::span<const Group> groups, std::span<const Move> moves,
                        const Run& run) {
  const std::string before = state();
  GroundUndo undo(ground_);
  std::vector<const Group*> group_of(machines_.size());
  std::atomic<bool> are_apart = true;
  {
    struct Release {
      Tracker& tracker;
      ~Release() {
        for (const auto& settler : tracker.settlers_) settler->confine({});
        tracker.raise_walls();
      }
    } const release{*this};
    for (const Group& group : groups) {
      std::vector<const Obstacle*> walls;
      for (const std::size_t m : group.machines) walls.push_back(&machines_[m]->wall());
      for (const std::size_t m : group.machines) {
        settlers_[m]->set_walls(walls);
        settlers_[m]->confine(group.cells);
        group_of[m] = &group;
      }
    }
    run_sequences(groups, [&](std::size_t i) {
      try {
        if (!are_apart) return;
        run(i);
        for (const std::size_t m : group_of[moves[i].machine]->machines)
          if (m != moves[i].machine) settlers_[m]->forget_changes();
      } catch (...) {  // an error comes again, in its turn
        are_apart = false;
      }
    });
  }
  if (are_apart) {
    ++batch_counts_.apart;
    last_in_turn_ = 0;
  } else {
    undo.undo();
    restore(before);
    ++batch_counts_.set_back;
    in_turn_ = last_in_turn_ = std::min(2 * last_in_turn_ + 1, kMaxBatchesInTurn);
  }
  for (const auto& settler : settlers_) settler->forget_changes();  // those of other groups
  return are_apart;
}

/// Groups that have moves. With one machine's moves there is one, of all machines.
std::vector<Tracker::Group> Tracker::apart(std::span<const Move> moves) const {
  std::vector<std::vector<std::size_t>> of_machine(machines_.size());
  for (std::size_t i = 0; i < moves.size(); ++i) of_machine[moves[i].machine].push_back(i);
  const auto is_idle = [](const auto& list) { return list.empty(); };
  if (std::count_if(of_machine.begin(), of_machine.end(), is_idle) + 1 >=
      std::ptrdiff_t(machines_.size())) {
    Group all;
    all.moves.resize(moves.size());
    std::iota(all.moves.begin(), all.moves.end(), std::size_t{0});
    return {all};
  }
  std::vector<Eigen::AlignedBox3d> boxes(machines_.size());
  tbb::parallel_for(std::size_t{0}, machines_.size(), [&](std::size_t m) {
    std::vector<Pose> path;
    for (const std::size_t i : of_machine[m]) {
      const Move& move = moves[i];
      if (move.motion == nullptr) {
        path.push_back(move.to);
      } else {
        const auto traced = move.motion->trace(move.begin_s, move.end_s, machines_[m]->bucket(),
                                               kCoarseBend * ground_.voxel_size_m(), kAnyStride);
        path.insert(path.end(), traced.begin(), traced.end());
      }
    }
    boxes[m] = machines_[m]->workspace(ground_, path);
  });
  const std::vector<std::size_t> group = moves_soil() ? groups_of_unions(boxes) : groups_of(boxes);
  std::vector<Group> groups(machines_.size());
  std::vector<Eigen::AlignedBox3d> around(machines_.size());
  for (std::size_t m = 0; m < machines_.size(); ++m) {
    groups[group[m]].machines.push_back(m);
    around[group[m]].extend(boxes[m]);
  }
  for (std::size_t i = 0; i < moves.size(); ++i) groups[group[moves[i].machine]].moves.push_back(i);
  for (std::size_t g = 0; g < groups.size(); ++g)
    if (!groups[g].moves.empty()) groups[g].cells = tiles_of(g, around);
  std::erase_if(groups, [](const Group& g) { return g.moves.empty(); });
  return groups;
}

}  // namespace soilvdb::inline v0
