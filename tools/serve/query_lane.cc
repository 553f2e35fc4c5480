// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/query_lane.h"

#include <exception>
#include <utility>

namespace soilvdb::tools {
namespace {

constexpr std::size_t kMostOfClient = 32, kMostInLane = 128;

}  // namespace

bool QueryLane::try_run(const std::string& client, std::function<void()> job) {
  {
    const std::lock_guard lock(mutex_);
    std::deque<std::function<void()>>& own = waiting_[client];
    if (own.size() >= kMostOfClient || count_ >= kMostInLane) {
      if (own.empty()) waiting_.erase(client);
      return false;
    }
    own.push_back(std::move(job));
    ++count_;
  }
  return thread_.try_run([this] { run_next(); });
}

void QueryLane::run_next() {
  std::function<void()> job;
  {
    const std::lock_guard lock(mutex_);
    if (waiting_.empty()) return;  // dropped
    auto turn = waiting_.upper_bound(last_);
    if (turn == waiting_.end()) turn = waiting_.begin();
    last_ = turn->first;
    job = std::move(turn->second.front());
    turn->second.pop_front();
    --count_;
    if (turn->second.empty()) waiting_.erase(turn);
  }
  job();
}

void QueryLane::drop() {
  std::map<std::string, std::deque<std::function<void()>>> dropped;  // destroyed without the lock
  const std::lock_guard lock(mutex_);
  dropped.swap(waiting_);
  count_ = 0;
}

void QueryLane::wait() {
  try {
    thread_.wait();
  } catch (const std::exception&) {  // the client of the query is gone
  }
}

}  // namespace soilvdb::tools
