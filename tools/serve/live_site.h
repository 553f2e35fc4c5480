// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site that is fed lines of JSON, and what its machines are at.
#pragma once

#include <chrono>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "io/journal/report.h"
#include "soilvdb/session.h"
#include "tools/run/run_totals.h"
#include "tools/serve/work_log.h"

namespace soilvdb::tools {

/// What a site had changed before it was opened.
struct ChangeBefore {
  double change_m3 = 0;
  std::int64_t mass = 0;  ///< in MassUnits
};

/// What a line says. @throw std::invalid_argument unless that is a JSON object
nlohmann::json object_of(std::string_view line);

/// For one thread.
class LiveSite {
 public:
  /// @param session before its first state
  explicit LiveSite(Session session, std::string name);
  /// One that is only looked at, after its last state.
  LiveSite(Session session, std::string name, WorkLog log, const ChangeBefore& before);

  /// Records it from here on, or goes on with what is recorded.
  void record(const Recording& recording,
              const std::function<void(const io::JournalExtent&)>& progress);

  /// Feeds a line, `{"machine": "digger", "time": 12.3, "joints": {"boom": 0.3, ..}}` or with
  /// `"position": [x, y, z], "rotation": [x, y, z, w]`.
  /// A line `{"machine": "digger", "clock": "reset"}` says that the clock of a machine is right
  /// from here on: it may go back to times before the last, and what it said before is forgotten.
  /// @return a line: the update, or `{"error": ..}` and the site is as it was
  std::string feed(std::string_view line);
  StepResult feed(const MachineState& state);

  Session& session() { return session_; }
  const Session& session() const { return session_; }
  const std::string& name() const { return name_; }
  /// Counts what was fed.
  std::uint64_t fed() const { return fed_; }
  /// First and latest time fed; NaN: none was.
  double from_s() const { return log_.from_s(); }
  double time_s() const { return log_.time_s(); }
  /// Counts how often earlier states got other times, as a clock was wrong.
  std::uint64_t clocks_set() const { return clocks_set_; }
  /// What messages tell to run. @param curl "curl -X POST" and its options
  /// @param address where it is served, "http://127.0.0.1:8470/"
  void set_address(std::string curl, std::string address) {
    curl_ = std::move(curl);
    address_ = std::move(address);
  }
  bool recorded() const { return recorded_; }

  /// What viewers are told of the machines, again and again.
  nlohmann::ordered_json state() const;
  /// What viewers are told once.
  nlohmann::ordered_json description() const;
  /// summary.json, but for totals().
  io::Summary summary() const;
  /// Of a session of this site; on any thread.
  RunTotals totals(const Session& ground) const;

 private:
  using Clock = std::chrono::steady_clock;
  MachineState parse(const nlohmann::json& json, std::vector<double>& joints) const;
  void reset_clock(const nlohmann::json& json);
  std::string how_to_set_clock(std::size_t machine) const;
  void require_likely(const MachineState& state) const;
  void require_soon(const MachineState& state);

  Session session_;
  std::string name_;
  std::string curl_ = "curl -X POST", address_ = "/";
  std::vector<std::vector<std::string>> joints_;  ///< of each machine, by name
  WorkLog log_;
  std::vector<Clock::time_point> moved_;  ///< each machine
  std::vector<double> doubted_s_;         ///< each machine's time that was too far ahead; else NaN
  io::Durations durations_;
  Clock::time_point begin_ = Clock::now();
  std::uint64_t fed_ = 0, clocks_set_ = 0;
  ChangeBefore before_;
  bool recorded_ = false;
};

}  // namespace soilvdb::tools
