// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where machines were of late, for sensors that they carry.
#pragma once

#include <cstddef>
#include <deque>
#include <map>
#include <optional>

#include "soilvdb/io/journal.h"
#include "tools/serve/work_log.h"

namespace soilvdb::tools {

/// The last states of each machine.
class MachinePlaces {
 public:
  struct State {
    std::optional<double> time_s;
    WorkLog::Place at;
  };
  void add(std::size_t machine, std::optional<double> time_s, WorkLog::Place at);
  void add(const io::JournalUpdate& update);
  /// Its earlier times count no more.
  void set_clock(std::size_t machine);
  /// The last state at or before a time, or the last without a time; null: none is known.
  const State* at(std::size_t machine, std::optional<double> time_s) const;
  /// The earliest time from which on places are known.
  std::optional<double> from_s(std::size_t machine) const;
  /// The latest time of any machine.
  std::optional<double> latest_s() const;

 private:
  std::map<std::size_t, std::deque<State>> states_;  // by machine, newest last
};

}  // namespace soilvdb::tools
