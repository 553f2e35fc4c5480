// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/background.h"

#include <sys/resource.h>
#include <tbb/task_arena.h>

#include <stdexcept>
#include <utility>

#include "core/constants.h"

namespace soilvdb::inline v0 {

Background::Background(bool thread, std::size_t most) : thread_used_(thread), most_(most) {
  if (most_ == 0)
    throw std::invalid_argument("a background thread must allow at least one waiting job");
  if (!thread_used_) return;
  thread_ = std::thread([this] {
    setpriority(PRIO_PROCESS, 0, kBackgroundNice);  // on Linux, of this thread alone
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
  if (thread_used_) {
    std::unique_lock lock(mutex_);
    came_along_.wait(lock, [&] { return jobs_.size() < most_; });
  }
  try_run(std::move(job));
  rethrow();
}

bool Background::try_run(std::function<void()> job) {
  if (!thread_used_) {
    guarded(job);
    return true;
  }
  {
    const std::lock_guard lock(mutex_);
    if (jobs_.size() >= most_) return false;
    jobs_.push_back(std::move(job));
  }
  wake_.notify_one();
  return true;
}

void Background::drop() {
  std::deque<std::function<void()>> dropped;  // destroyed after the lock is released
  const std::lock_guard lock(mutex_);
  dropped.swap(jobs_);
}

void Background::wait() {
  if (thread_used_) {
    std::unique_lock lock(mutex_);
    came_along_.wait(lock, [&] { return !busy_ && jobs_.empty(); });
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
  for (;;) {
    wake_.wait(lock, [&] { return ending_ || !jobs_.empty(); });
    if (jobs_.empty()) return;
    busy_ = true;
    {
      const std::function<void()> job = std::move(jobs_.front());
      jobs_.pop_front();
      came_along_.notify_all();
      lock.unlock();
      guarded(job);
    }  // destroyed before it counts as done
    lock.lock();
    busy_ = false;
    came_along_.notify_all();
  }
}

void Background::guarded(const std::function<void()>& job) {
  try {
    job();
  } catch (...) {
    const std::lock_guard lock(mutex_);
    errors_.push_back(std::current_exception());
  }
}

}  // namespace soilvdb::inline v0
