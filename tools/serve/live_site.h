// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site that is fed lines of JSON, and what its machines are at.
#pragma once

#include <chrono>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/journal/report.h"
#include "soilvdb/session.h"
#include "tools/run/books.h"

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

/// For one thread.
class LiveSite {
 public:
  /// @param session before its first state
  explicit LiveSite(Session session, std::string name);

  /// Records it from here on, or goes on with what is recorded.
  void record(const Recording& recording,
              const std::function<void(const io::JournalExtent&)>& progress);

  /// Feeds a line, `{"machine": "digger", "time": 12.3, "joints": {"boom": 0.3, ..}}` or with
  /// `"position": [x, y, z], "rotation": [x, y, z, w]`.
  /// @return a line: the update, or `{"error": ..}` and the site is as it was
  std::string feed(std::string_view line);
  StepResult feed(const MachineState& state);

  Session& session() { return session_; }
  const Session& session() const { return session_; }
  const std::string& name() const { return name_; }
  /// Counts what was fed.
  std::uint64_t fed() const { return fed_; }
  /// Latest time fed; NaN: none was.
  double time_s() const { return time_s_; }
  bool recorded() const { return recorded_; }

  /// What viewers are told of the machines, again and again.
  nlohmann::ordered_json state() const;
  /// What viewers are told once.
  nlohmann::ordered_json description() const;
  /// A row for each machine.
  std::string machines_csv() const;
  /// summary.json, but for books().
  io::Summary summary() const;
  /// Of a session of this site; on any thread.
  Books books(const Session& ground) const;

 private:
  using Clock = std::chrono::steady_clock;
  struct Work {
    std::vector<std::string> joints;
    double capacity_m3 = 0;  ///< struck; 0: not known
    CycleCounter cycles;
    Pose last = {};
    Clock::time_point fed = {}, moved = {};
  };
  MachineState parse(std::string_view line, std::vector<double>& joints) const;
  void require_near(const MachineState& state) const;
  nlohmann::ordered_json machine_state(std::size_t machine) const;

  Session session_;
  std::string name_;
  std::vector<Work> work_;
  io::Durations durations_;
  Clock::time_point begin_ = Clock::now();
  std::uint64_t fed_ = 0;
  double time_s_;
  double change_before_m3_;
  std::int64_t mass_before_;
  bool recorded_ = false;
};

}  // namespace soilvdb::tools
