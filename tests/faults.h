// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How many faults a test injects, and the lines from which tools/bench makes its table of them.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdlib>
#include <string>
#include <string_view>

#include "tests/sanitized.h"

namespace soilvdb::testing {

/// SOILVDB_FAULTS in the environment chooses `quick` or `many` (long); both are for `tools/bench
/// faults`. Sanitizers see what the program does at a fault from few of them.
inline std::size_t faults(std::size_t quick, std::size_t usual, std::size_t many) {
  const char* text = std::getenv("SOILVDB_FAULTS");
  const std::string_view form = text ? text : "";
  return form == "long" ? many : form == "quick" || test::kSanitized ? quick : usual;
}

/// Says, at a test's end, what it did how often and what came of it.
inline void record_faults(const std::string& what, std::size_t count, const std::string& outcome) {
  const ::testing::TestResult& result =
      *::testing::UnitTest::GetInstance()->current_test_info()->result();
  int failures = 0;
  for (int i = 0; i < result.total_part_count(); ++i)
    failures += result.GetTestPartResult(i).failed();
  ::testing::Test::RecordProperty("faults", std::to_string(count));
  fmt::print("FAULTS,{},{},{},{}\n", what, count, outcome, failures);
}

}  // namespace soilvdb::testing
