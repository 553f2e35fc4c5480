// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Which machine moves when: the updates of a run, in the order of time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/pour_parts.h"

namespace soilvdb::tools {

/// Machine `machine` moves on over [begin_s, end_s]: one update, or a piece of it. Pours are
/// numbered after the machines, and have no motion.
struct Step {
  std::size_t machine = 0;
  double begin_s = 0, end_s = 0;
  std::shared_ptr<const Motion> motion;  ///< the part of the machine's that covers the step
  bool ends_update = true;
};

/// Is a step the one that a journal's update was, to the last bit of its times?
inline bool is_update(const Step& step, const io::JournalUpdate& update) {
  return step.machine == update.machine && io::same_bits(step.begin_s, update.begin_s) &&
         io::same_bits(step.end_s, update.end_s);
}

/// The updates of several machines, merged by the time at which they end; at equal times in the
/// order of the machines. A machine's steps follow on each other and cover its whole motion. Where
/// parts of a long motion meet within an update, it comes in several steps, one after the other.
/// Each part of a pour is an update among them, when it falls.
/// Where a motion stops at a bad row, all machines do, with their last updates that end before it.
class Schedule {
 public:
  /// @param scenario outlives the schedule
  /// @param updates even intervals of each motion; without it one update per row, of which the
  ///        first places the bucket. A motion of one row always makes one update.
  /// @param ends_s where each motion ended when the run began, as ends_of() has them: it makes so
  ///        many updates up to there, and goes on in the same intervals if it is longer by now
  /// @param tolerance_m of Motion::simplified(), by which rows are left out that say no more than
  ///        their neighbours, where an update covers several and soil doesn't move
  Schedule(const io::Scenario& scenario, std::optional<std::int64_t> updates,
           const std::vector<double>& ends_s, double tolerance_m);

  std::int64_t total() const { return total_; }  ///< updates
  double begin_s() const { return begin_s_; }    ///< of the earliest motion or pour
  double end_s() const { return end_s_; }        ///< of the latest

  /// The bad row at which it stops, and what is wrong with it; empty: it doesn't.
  const std::string& stops_at() const { return stops_at_; }

  /// @throw std::runtime_error if a motion can't be read any more.
  std::optional<Step> next();

 private:
  class Cursor {
   public:
    Cursor(const io::MachineInput& machine, std::optional<std::int64_t> updates, double end_s,
           std::optional<double> thinned_m);
    std::int64_t count() const { return count_; }
    bool at_end() const { return done_ == count_; }
    double until_s() const { return until_s_; }  ///< where the update it is in ends
    Step step();

   private:
    void load(std::size_t part);
    void aim();
    double boundary_s(std::int64_t update) const;

    const io::MachineInput* machine_;
    bool by_rows_;
    std::optional<double> thinned_m_;  // of Motion::simplified()
    std::int64_t intervals_;           // even ones, up to planned_s_
    double planned_s_;                 // where the motion ended when the run began
    std::int64_t count_, done_ = 0;    // updates
    std::size_t part_ = 0, row_ = 0;
    std::shared_ptr<const Motion> motion_;  // part_ of the machine's
    double at_s_, until_s_ = 0;             // where the last step ended, where the update ends
  };
  class PourCursor {
   public:
    explicit PourCursor(const PourParts& parts) : parts_(parts) {}
    std::int64_t count() const { return parts_.count(); }
    bool at_end() const { return done_ == count(); }
    double until_s() const { return parts_.falls_s(done_ + 1); }
    Step step();

   private:
    PourParts parts_;
    std::int64_t done_ = 0;
  };
  std::vector<Cursor> cursors_;
  std::vector<PourCursor> pours_;
  std::int64_t total_ = 0;
  double begin_s_ = 0, end_s_ = 0;
  double stop_s_;
  std::string stops_at_;
};

/// Where each motion ends.
std::vector<double> ends_of(const std::vector<io::MachineInput>& machines);

}  // namespace soilvdb::tools
