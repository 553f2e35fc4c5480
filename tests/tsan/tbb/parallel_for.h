// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Stands before TBB's header of this name under the thread sanitizer. The distribution's TBB isn't
// built for it, so how TBB hands work from thread to thread is unseen, and all that bodies share
// with who called them looks like a race. Here they run on threads of the standard library, which
// it sees: between bodies nothing is ordered, and what two of them touch is reported. TBB itself,
// which OpenVDB uses besides, gets no threads.
#pragma once

#include <tbb/global_control.h>
#include_next <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <concepts>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace tbb {

inline const global_control kNoWorkers(global_control::max_allowed_parallelism, 1);

/// Calls f(0) ... f(n - 1) on four threads.
template <typename F>
void on_threads(std::size_t n, const F& f) {
  std::atomic<std::size_t> next = 0;
  std::exception_ptr error;
  std::mutex mutex;
  const auto work = [&] {
    try {
      // Relaxed: handing out numbers must not order what is done with them.
      for (std::size_t i; (i = next.fetch_add(1, std::memory_order_relaxed)) < n;) f(i);
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!error) error = std::current_exception();
    }
  };
  std::vector<std::thread> others;
  for (std::size_t i = 1; i < std::min<std::size_t>(n, 4); ++i) others.emplace_back(work);
  work();
  for (std::thread& other : others) other.join();
  if (error) std::rethrow_exception(error);
}

template <std::integral Index, typename F>
void parallel_for_on_threads(Index first, Index last, const F& f) {
  if (first >= last) return;
  on_threads(static_cast<std::size_t>(last - first),
             [&](std::size_t i) { f(static_cast<Index>(first + static_cast<Index>(i))); });
}

/// Over a range, which is how OpenVDB asks: not shared out.
template <typename Range, typename Body, typename... How>
requires(!std::integral<Range>) void parallel_for_on_threads(const Range& range, const Body& body,
                                                             How&&...) {
  Range all(range);
  const Body own(body);
  own(all);
}

}  // namespace tbb

#define parallel_for parallel_for_on_threads
