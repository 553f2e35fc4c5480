// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the site of a run was like at any time of it, out of its folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/session.h"
#include "tools/run/run_config.h"

namespace soilvdb::tools {

/// For one thread at a time. A run that goes on is seen as far as its journal came when this was
/// made.
class RunPast {
 public:
  /// @throw io::InputError for a folder without a journal of a run, or if an input of it has
  ///        changed
  explicit RunPast(std::filesystem::path folder);

  const io::Scenario& scenario() const { return scenario_; }
  const RunConfig& config() const { return config_; }
  const io::JournalContent& journal() const { return journal_; }
  /// Of the earliest motion or pour.
  double begin_s() const;

  /// Calls `each` with the moves that ended by a time, in their order.
  void moves(double until_s, const std::function<void(const io::JournalMove&)>& each) const;
  /// Ground, ledgers and machines after those moves, from the newest snapshot before: for who
  /// looks.
  /// @throw std::runtime_error in one line if they cut something else than they did
  Session at(double time_s) const;

 private:
  struct Start;
  Start find_start(std::uint64_t updates, bool whole) const;
  std::filesystem::path folder_;
  io::JournalContent journal_;
  RunConfig config_;
  io::Scenario scenario_;
};

}  // namespace soilvdb::tools
