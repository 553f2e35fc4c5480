// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A thread beside updates, for what may be late.
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

/// Runs jobs in their order, on one core and at a lower priority than the thread that made it.
///
/// An error of a job is thrown once, by a later run() or wait(); what that call was to do is done
/// all the same, and the jobs after it run. Functions may be called by one thread at a time.
///
/// ```
/// Background background(true);
/// background.run([copy] { save(copy); });
/// background.wait();   // throws if it couldn't be saved
/// ```
class Background {
 public:
  /// @param thread else run() does its work before it returns
  /// @param most jobs that may wait, 1 or more
  explicit Background(bool thread, std::size_t most = std::numeric_limits<std::size_t>::max());
  /// Runs the jobs that wait. Errors not thrown yet are lost: wait() first.
  ~Background();
  Background(const Background&) = delete;
  Background& operator=(const Background&) = delete;

  /// Waits until there is room for it.
  void run(std::function<void()> job);
  /// The same without waiting, for who can do without. Throws no errors of jobs.
  /// @return false: so many wait already that it isn't taken
  bool try_run(std::function<void()> job);
  /// Forgets the jobs that haven't begun.
  void drop();
  /// Waits until all is done.
  void wait();
  /// Is all done?
  bool done() const;
  /// Throws the oldest error that hasn't been thrown yet.
  void rethrow();

 private:
  void serve();
  void guarded(const std::function<void()>& job);

  const bool thread_used_;
  const std::size_t most_;
  mutable std::mutex mutex_;                   // for all below
  std::condition_variable wake_, came_along_;  // for the thread; for who waits for it
  std::deque<std::function<void()>> jobs_;
  bool busy_ = false, ending_ = false;
  std::deque<std::exception_ptr> errors_;
  std::thread thread_;
};

}  // namespace soilvdb::inline v0
