// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/background.h"

#include <sys/resource.h>
#include <tbb/task_arena.h>

#include <utility>

namespace soilvdb::inline v0 {

Background::Background(bool thread, std::function<bool()> idle)
    : thread_used_(thread), idle_(std::move(idle)) {
  if (!thread_used_) return;
  thread_ = std::thread([this] {
    constexpr int kNice = 10;
    setpriority(PRIO_PROCESS, 0, kNice);  // of this thread alone on Linux; in vain elsewhere
    tbb::task_arena(1).execute([this] { serve(); });
  });
}

Background::~Background() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

void Background::run(std::function<void()> job) {
  if (!thread_used_) {
    guarded(job);
    while (rest()) {
    }
    return rethrow();
  }
  {
    const std::lock_guard lock(mutex_);
    jobs_.push_back(std::move(job));
  }
  wake_.notify_one();
  rethrow();
}

void Background::wait() {
  if (thread_used_) {
    std::unique_lock lock(mutex_);
    all_done_.wait(lock, [&] { return !busy_ && jobs_.empty(); });
  }
  rethrow();
}

bool Background::done() const {
  const std::lock_guard lock(mutex_);
  return !busy_ && jobs_.empty();
}

void Background::rethrow() {
  std::exception_ptr error;
  {
    const std::lock_guard lock(mutex_);
    if (errors_.empty()) return;
    error = std::move(errors_.front());
    errors_.pop_front();
  }
  std::rethrow_exception(error);
}

void Background::serve() {
  std::unique_lock lock(mutex_);
  for (bool more = false;;) {
    if (!jobs_.empty()) {
      busy_ = more = true;
      {
        const std::function<void()> job = std::move(jobs_.front());
        jobs_.pop_front();
        lock.unlock();
        guarded(job);
      }  // what it holds goes before it counts as done
      lock.lock();
    } else if (ending_) {
      return;
    } else if (more) {
      lock.unlock();
      more = rest();
      lock.lock();
    } else {
      busy_ = false;
      all_done_.notify_all();
      wake_.wait(lock, [&] { return ending_ || !jobs_.empty(); });
    }
  }
}

/// @return whether there may be more to do
bool Background::rest() {
  bool more = idle_ != nullptr;  // after an error, too
  if (more) guarded([&] { more = idle_(); });
  return more;
}

void Background::guarded(const std::function<void()>& work) {
  try {
    work();
  } catch (...) {
    const std::lock_guard lock(mutex_);
    errors_.push_back(std::current_exception());
  }
}

}  // namespace soilvdb::inline v0
