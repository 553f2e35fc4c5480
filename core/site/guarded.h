// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Work of a Site whose errors become results.
#pragma once

#include <stdexcept>
#include <string>

#include "soilvdb/site.h"

namespace soilvdb::inline v0 {

/// The reason in a result, or an empty one if there is no memory for it.
template <typename Result>
Result refused(Status status, const std::string& why) noexcept {
  Result result;
  result.status = status;
  try {
    result.why = why;
  } catch (...) {
  }
  return result;
}

/// Calls `work(moving)`, which must set `moving` before its first irreversible change.
template <typename Result, typename Work>
Result Site::guarded(const Work& work) noexcept {
  if (!broken_.empty()) return refused<Result>(Status::kFailed, broken_);
  bool moving = false;
  const auto failed = [&](Status status, const char* why) {
    if (!moving) return refused<Result>(status, why);
    fail(why);
    return refused<Result>(Status::kFailed, broken_);
  };
  try {
    return work(moving);
  } catch (const NoGroundError& e) {
    return failed(Status::kNoGround, e.what());
  } catch (const std::invalid_argument& e) {
    return failed(Status::kBadState, e.what());
  } catch (const std::exception& e) {
    return failed(Status::kFailed, e.what());
  }
}

}  // namespace soilvdb::inline v0
