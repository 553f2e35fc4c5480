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
#include "tools/serve/work_log.h"

namespace soilvdb::tools {

/// What a site had changed before it was opened.
struct ChangeBefore {
  double change_m3 = 0;
  std::int64_t mass = 0;  ///< in MassUnits
};

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
  /// @return a line: the update, or `{"error": ..}` and the site is as it was
  std::string feed(std::string_view line);
  StepResult feed(const MachineState& state);

  Session& session() { return session_; }
  const Session& session() const { return session_; }
  const std::string& name() const { return name_; }
  /// Counts what was fed.
  std::uint64_t fed() const { return fed_; }
  /// Latest time fed; NaN: none was.
  double time_s() const { return log_.time_s(); }
  bool recorded() const { return recorded_; }

  /// What viewers are told of the machines, again and again.
  nlohmann::ordered_json state() const;
  /// What viewers are told once.
  nlohmann::ordered_json description() const;
  /// summary.json, but for books().
  io::Summary summary() const;
  /// Of a session of this site; on any thread.
  Books books(const Session& ground) const;

 private:
  using Clock = std::chrono::steady_clock;
  MachineState parse(std::string_view line, std::vector<double>& joints) const;
  void require_likely(const MachineState& state) const;
  void require_soon(const MachineState& state);

  Session session_;
  std::string name_;
  std::vector<std::vector<std::string>> joints_;  ///< of each machine, by name
  WorkLog log_;
  std::vector<Clock::time_point> moved_;  ///< each machine
  std::vector<double> doubted_s_;         ///< each machine's time that was too far ahead; else NaN
  io::Durations durations_;
  Clock::time_point begin_ = Clock::now();
  std::uint64_t fed_ = 0;
  ChangeBefore before_;
  bool recorded_ = false;
};

}  // namespace soilvdb::tools
