// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Durations of updates.
#pragma once

#include <chrono>

#include "soilvdb/tracker.h"

namespace soilvdb::inline v0 {

inline double us_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin)
      .count();
}

/// Calls `f()`, which gives an update, and times it.
template <typename F>
Update timed(F f) {
  const auto begin = std::chrono::steady_clock::now();
  Update update = f();
  update.us = us_since(begin);
  return update;
}

}  // namespace soilvdb::inline v0
