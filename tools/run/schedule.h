// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The order of a run's updates in time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/pour_parts.h"

namespace soilvdb::tools {

/// Machine `machine` moves over [begin_s, end_s]: an update, or a piece of one. Pours are numbered
/// after the machines, and scans after the pours. These have no motion.
struct Step {
  std::size_t machine = 0;
  double begin_s = 0, end_s = 0;
  /// The part of the machine's motion that covers the step; of a scan, that of its carrier.
  std::shared_ptr<const Motion> motion;
  bool ends_update = true;
};

/// Is a step the same as a journal's update, with the same bits of its times?
inline bool is_update(const Step& step, const io::JournalUpdate& update) {
  return step.machine == update.machine && io::same_bits(step.begin_s, update.begin_s) &&
         io::same_bits(step.end_s, update.end_s);
}

/// The updates of all machines, ordered by their ends; at equal times by machine. A machine's steps
/// are consecutive and cover its whole motion. An update across parts of a long motion has several
/// consecutive steps. Each part of a pour is an update at the time of its fall. If a motion stops
/// at a bad row, all machines stop, after their last updates that end before it.
class Schedule {
 public:
  /// @param scenario must outlive the schedule
  /// @param updates number of even intervals of each motion; default: one update per row, the first
  ///        of which places the bucket. A motion of one row always makes one update.
  /// @param ends_s ends_of() the motions when the run began. `updates` intervals reach up to there;
  ///        a motion that is longer now continues with intervals of the same length.
  /// @param tolerance_m of Motion::simplified(), which omits redundant rows if an update covers
  ///        several rows and soil is rigid
  Schedule(const io::Scenario& scenario, std::optional<std::int64_t> updates,
           const std::vector<double>& ends_s, double tolerance_m);

  std::int64_t total() const { return total_; }  ///< number of updates
  double begin_s() const { return begin_s_; }    ///< of the earliest motion or pour
  double end_s() const { return end_s_; }        ///< of the latest

  /// The bad row at which it stops, with the reason; empty: it does not stop.
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
    double until_s() const { return until_s_; }  ///< end of the current update
    Step step();
    /// The part of the motion at a time from the last step on; null without one.
    std::shared_ptr<const Motion> motion_at(double time_s) const;

   private:
    void load(std::size_t part);
    void aim();
    double boundary_s(std::int64_t update) const;

    const io::MachineInput* machine_;
    bool by_rows_;
    std::optional<double> thinned_m_;  // of Motion::simplified()
    std::int64_t intervals_;           // number of even intervals up to planned_s_
    double planned_s_;                 // end of the motion when the run began
    std::int64_t count_, done_ = 0;    // updates
    std::size_t part_ = 0, row_ = 0;
    std::shared_ptr<const Motion> motion_;  // part_ of the machine's
    double at_s_, until_s_ = 0;             // end of the last step; end of the update
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
  std::span<const io::ScanInput> scans_;
  std::size_t scanned_ = 0;  ///< scans that were taken
  std::int64_t total_ = 0;
  double begin_s_ = 0, end_s_ = 0;
  double stop_s_;
  std::string stops_at_;
};

/// The end of each motion.
std::vector<double> ends_of(const std::vector<io::MachineInput>& machines);

}  // namespace soilvdb::tools
