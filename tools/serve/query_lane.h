// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A thread for queries, on which clients take turns.
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <string>

#include "soilvdb/background.h"

namespace soilvdb::tools {

/// Runs the jobs of each client in their order, and one of each client with jobs after another. One
/// thread may call the members.
class QueryLane {
 public:
  /// @return false if the client or all clients have too many jobs waiting
  bool try_run(const std::string& client, std::function<void()> job);
  /// Discards the jobs that have not begun.
  void drop();
  /// Waits until all jobs have ended; their errors are lost.
  void wait();

 private:
  void run_next();

  std::mutex mutex_;  // guards the members below
  std::map<std::string, std::deque<std::function<void()>>> waiting_;
  std::size_t count_ = 0;
  std::string last_;  // whose turn it was
  Background thread_{/*thread=*/true};
};

}  // namespace soilvdb::tools
