// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How threads run that work beside updates.
#pragma once

#include <sys/resource.h>
#include <tbb/task_arena.h>

namespace soilvdb::inline v0 {

/// Calls `f()` on one core, and from then on has this thread at a lower priority than updates.
template <typename F>
void run_in_background(const F& f) {
  constexpr int kNice = 10;
  setpriority(PRIO_PROCESS, 0, kNice);  // of this thread alone on Linux; in vain elsewhere
  tbb::task_arena(1).execute(f);
}

}  // namespace soilvdb::inline v0
