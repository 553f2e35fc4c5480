// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Main function of a room's tests. `--file NAME` runs the tests of NAME.cc alone.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <string_view>

namespace {

/// A filter that matches the tests of `stem`.cc; empty if there are none.
std::string filter_of(std::string_view stem) {
  std::string filter;
  const auto& all = *::testing::UnitTest::GetInstance();
  for (int s = 0; s < all.total_test_suite_count(); ++s) {
    const auto& suite = *all.GetTestSuite(s);
    for (int t = 0; t < suite.total_test_count(); ++t) {
      const auto& test = *suite.GetTestInfo(t);
      if (std::filesystem::path(test.file()).stem() != stem) continue;
      filter += std::string(filter.empty() ? "" : ":") + suite.name() + "." + test.name();
    }
  }
  return filter;
}

}  // namespace

int main(int argc, char** argv) {
  ::testing::InitGoogleMock(&argc, argv);
  if (argc == 3 && std::string_view(argv[1]) == "--file") {
    const std::string filter = filter_of(argv[2]);
    if (filter.empty()) {
      std::fprintf(stderr, "there is no test in %s.cc\n", argv[2]);
      return 2;
    }
    GTEST_FLAG_SET(filter, filter);
  } else if (argc > 1) {
    std::fprintf(stderr, "expected --file NAME or GoogleTest's options, not '%s'\n", argv[1]);
    return 2;
  }
  return RUN_ALL_TESTS();
}
