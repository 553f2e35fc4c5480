// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Stands before TBB's header of this name under the thread sanitizer, which reports races inside
// the distribution's isolate(). Bodies run on threads of the standard library (parallel_for.h),
// which never start another task while they wait, so there is nothing to isolate.
#pragma once

#include_next <tbb/task_arena.h>

namespace tbb::this_task_arena {

template <typename F>
auto isolate_nothing(const F& f) {
  return f();
}

}  // namespace tbb::this_task_arena

#define isolate isolate_nothing
