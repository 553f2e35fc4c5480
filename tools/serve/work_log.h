// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The machines' work that their session does not know: cycles, and times of their last moves.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/session.h"
#include "tools/serve/work_minutes.h"

namespace soilvdb::tools {

/// Counts a machine's cycles: a cycle ends when the bucket loses most of its load, and leaves the
/// ground before it takes up the next.
class CycleCounter {
 public:
  /// @param least_m3 smaller loads do not count
  explicit CycleCounter(double least_m3 = 0) : least_m3_(least_m3) {}
  /// @param cuts the bucket is in the ground
  void add(double load_m3, bool cuts);
  std::int64_t cycles() const { return cycles_; }
  /// Largest load in the last complete cycle, loose; empty before the first.
  std::optional<double> last_load_m3() const { return last_m3_; }

 private:
  double least_m3_;
  double peak_m3_ = 0, trough_m3_ = 0;
  double largest_m3_ = 0;  ///< since the last cycle
  bool emptying_ = false;
  bool counted_ = false;  ///< the load that is or was lost
  std::int64_t cycles_ = 0;
  std::optional<double> last_m3_ = {};
};

/// A machine is idle if it has not moved for this time.
inline constexpr double kIdleAfter_s = 10;
/// After a longer silence nobody knows whether it worked or was idle.
inline constexpr double kSilentAfter_s = 60;

/// The work of all machines, from live states or a journal.
class WorkLog {
 public:
  /// Where a machine is.
  struct Place {
    std::vector<double> numbers = {};  ///< of its joints and base; or position and rotation
    bool joints = false;
  };
  /// Soil of a new state.
  struct Soil {
    std::int64_t cut = 0;                    ///< samples
    std::int64_t load = 0;                   ///< in the bucket after it, units of mass
    std::int64_t put_down = 0;               ///< left the bucket
    std::optional<std::int64_t> hauled = 0;  ///< into hoppers; empty: not recorded
  };
  struct Machine {
    double capacity_m3 = 0;  ///< struck; 0: unknown
    std::size_t joints = 0;
    CycleCounter cycles;
    WorkMinutes minutes = {};
    Work untimed = {};                   ///< before the site's first time
    std::int64_t load = 0;               ///< after its last state, units of mass
    Place stood = {};                    ///< when it moved last
    std::optional<double> moved_s = {};  ///< the site's time when it moved last
    std::optional<double> time_s = {};   ///< its latest
    bool clock_is_set = false;           ///< its clock was set, and it has sent no time since
  };

  explicit WorkLog(const Session& site);
  /// Takes over machines and hoppers that came since.
  void follow(const Session& site);

  /// A machine has a new state. @return whether it has moved, farther than a sensor errs
  bool add(std::size_t machine, std::optional<double> time_s, Place at, const Soil& soil);
  void add(const io::JournalUpdate& update);

  const std::vector<Machine>& machines() const { return machines_; }
  /// A machine's wrong clock was set: its earlier times are forgotten.
  void set_clock(std::size_t machine);
  /// First and latest time, if a state had one.
  std::optional<double> from_s() const { return from_s_; }
  std::optional<double> time_s() const { return time_s_; }
  /// The ground became that of a survey: how it changed then is no work.
  void note_survey() { surveyed_s_ = time_s_; }
  /// The latest time at which it did.
  std::optional<double> surveyed_s() const { return surveyed_s_; }
  /// A scan corrected the ground.
  void note_scan() { scanned_s_ = time_s_; }
  /// The site's time when one did last.
  std::optional<double> scanned_s() const { return scanned_s_; }
  /// Did a machine move shortly before the latest time?
  bool works(std::size_t machine) const;

 private:
  void note_time(double time_s);
  void add(std::size_t machine, std::optional<double> time_s, bool moved, const Soil& soil);
  void add_time(Machine& work, std::optional<double> before_s, double time_s, bool moved);

  double loose_m3_;  ///< per unit of mass
  /// Time from which updates must record what hoppers received; empty: there are no hoppers.
  std::optional<double> hauls_from_s_;
  std::vector<Machine> machines_;
  std::optional<double> from_s_, time_s_, surveyed_s_, scanned_s_;
};

/// A site's repeated message to viewers: its machines' places, loads and work.
/// @param works by machine
nlohmann::ordered_json site_state(const Session& site, const WorkLog& log,
                                  const std::vector<bool>& works);
/// As above at the log's end.
nlohmann::ordered_json site_state(const Session& site, const WorkLog& log);
/// A row for each machine of such a state.
std::string machines_csv(const nlohmann::ordered_json& state);

}  // namespace soilvdb::tools
