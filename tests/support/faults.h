// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How many faults a test injects, and the lines from which tools/bench makes its table of them.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdlib>
#include <string>

#include "tests/support/sanitized.h"

namespace soilvdb::test {

/// `few` in tests, `some` in long ones (`tools/test --long`), `many` in `tools/bench faults`, which
/// sets SOILVDB_FAULTS. Sanitizers see what the program does at a fault from a few of those.
inline std::size_t faults(std::size_t few, std::size_t some, std::size_t many) {
  if (std::getenv("SOILVDB_FAULTS")) return many;
  if (test::kSanitized) return (few + 2) / 3;
  return test::kLong ? some : few;
}

/// The same, of what is done at every so many-th place only; `tools/bench faults` does all.
inline std::size_t fault_step(std::size_t few, std::size_t some) {
  if (std::getenv("SOILVDB_FAULTS")) return 1;
  if (test::kSanitized) return 3 * few;
  return test::kLong ? some : few;
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

}  // namespace soilvdb::test
