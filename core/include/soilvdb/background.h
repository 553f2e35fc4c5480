// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A thread beside updates, for what may be late.
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
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
  /// @param idle called while no job waits, until it says that there is nothing to do: the next
  ///        time is after a job. Its errors are as those of jobs
  explicit Background(bool thread, std::function<bool()> idle = {});
  /// Runs the jobs that wait, and idle() no more. Errors not thrown yet are lost: wait() first.
  ~Background();
  Background(const Background&) = delete;
  Background& operator=(const Background&) = delete;

  void run(std::function<void()> job);
  /// Waits until all is done, idle() too.
  void wait();
  /// Is all done?
  bool done() const;
  /// Throws the oldest error that hasn't been thrown yet.
  void rethrow();

 private:
  void serve();
  bool rest();
  void guarded(const std::function<void()>& work);

  const bool thread_used_;
  const std::function<bool()> idle_;
  mutable std::mutex mutex_;  // for all below
  std::condition_variable wake_, all_done_;
  std::deque<std::function<void()>> jobs_;
  bool busy_ = false, ending_ = false;
  std::deque<std::exception_ptr> errors_;
  std::thread thread_;
};

}  // namespace soilvdb::inline v0
