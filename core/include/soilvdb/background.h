// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A low-priority worker thread for jobs that may finish late.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <limits>
#include <mutex>
#include <thread>

namespace soilvdb::inline v0 {

/// Runs jobs in order, on one core and at a lower priority than the constructing thread.
///
/// A later run(), wait() or rethrow() throws each job's error once. That call still does its work,
/// and later jobs still run. Only one thread at a time may call the members.
///
/// ```
/// Background background(true);
/// background.run([copy] { save(copy); });
/// background.wait();   // throws if save() failed
/// ```
class Background {
 public:
  /// @param thread false: run() executes the job itself before it returns
  /// @param most maximum number of waiting jobs, >= 1. @throw std::invalid_argument for 0
  explicit Background(bool thread, std::size_t most = std::numeric_limits<std::size_t>::max());
  /// Runs the waiting jobs. Errors that were not thrown are lost: call wait() first.
  ~Background();
  Background(const Background&) = delete;
  Background& operator=(const Background&) = delete;

  /// Queues a job; waits while the queue is full.
  void run(std::function<void()> job);
  /// Queues a job without waiting. Throws no errors of jobs.
  /// @return false if the queue is full; the job is then not queued
  bool try_run(std::function<void()> job);
  /// Discards the jobs that have not begun.
  void drop();
  /// Waits until all jobs have ended.
  void wait();
  /// Whether all jobs have ended.
  bool done() const;
  /// Throws the oldest error that was not thrown yet, if there is one.
  void rethrow();

 private:
  void serve();
  void guarded(const std::function<void()>& job);

  const bool thread_used_;
  const std::size_t most_;
  mutable std::mutex mutex_;                   // guards the members below
  std::condition_variable wake_, came_along_;  // for the worker; for waiting callers
  std::deque<std::function<void()>> jobs_;
  bool busy_ = false, ending_ = false;
  std::deque<std::exception_ptr> errors_;
  std::thread thread_;
};

}  // namespace soilvdb::inline v0
