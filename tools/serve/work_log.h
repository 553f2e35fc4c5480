// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What machines have done, besides what their session knows: cycles, and when they moved last.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/session.h"

namespace soilvdb::tools {

/// Counts a machine's cycles by its load: one ends when the bucket loses most of what it held.
class CycleCounter {
 public:
  /// @param least_m3 loads that are less are none
  explicit CycleCounter(double least_m3 = 0) : least_m3_(least_m3) {}
  void add(double load_m3);
  std::int64_t cycles() const { return cycles_; }
  /// Most that the bucket held in the last cycle that ended, loose; nothing before the first.
  std::optional<double> last_load_m3() const { return last_m3_; }

 private:
  double least_m3_;
  double peak_m3_ = 0, trough_m3_ = 0;
  bool emptying_ = false;
  std::int64_t cycles_ = 0;
  std::optional<double> last_m3_ = {};
};

/// A machine that hasn't moved for so long is idle.
inline constexpr double kIdleAfter_s = 10;

/// Of all machines of a site, state by state as they come or from a journal.
class WorkLog {
 public:
  struct Machine {
    double capacity_m3 = 0;  ///< struck; 0: not known
    CycleCounter cycles;
    std::vector<double> at = {};                                ///< its last state's numbers
    double moved_s = -std::numeric_limits<double>::infinity();  ///< of the site's times
    double time_s = std::numeric_limits<double>::quiet_NaN();   ///< its latest
    bool clock_is_set = false;                                  ///< and it has told no time since
  };

  explicit WorkLog(const Session& site);

  /// A machine was brought somewhere. @param at numbers that say where
  /// @return whether it was elsewhere before
  bool add(std::size_t machine, double time_s, std::vector<double> at, double load_m3);
  void add(const io::JournalUpdate& update);

  const std::vector<Machine>& machines() const { return machines_; }
  /// The clock of a machine was wrong and is set: what it said before is forgotten.
  void set_clock(std::size_t machine);
  /// First and latest time; NaN: none was.
  double from_s() const { return from_s_; }
  double time_s() const { return time_s_; }
  /// Did a machine move in the seconds before the last that is known?
  bool works(std::size_t machine) const;

 private:
  void note_time(double time_s);

  double loose_m3_;  ///< of a unit of mass
  std::vector<Machine> machines_;
  double from_s_ = std::numeric_limits<double>::quiet_NaN();
  double time_s_ = std::numeric_limits<double>::quiet_NaN();
};

/// What viewers are told of a site again and again: where its machines are, what they hold and did.
/// @param works which of them do
nlohmann::ordered_json site_state(const Session& site, const WorkLog& log,
                                  const std::vector<bool>& works);
/// The same as of the log's end.
nlohmann::ordered_json site_state(const Session& site, const WorkLog& log);
/// A row for each machine of such a state.
std::string machines_csv(const nlohmann::ordered_json& state);

}  // namespace soilvdb::tools
