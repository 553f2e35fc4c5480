// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs on measured terrain, where that is there.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/support/program.h"

namespace soilvdb::test {

inline fs::path shared() {
  const char* folder = std::getenv("SOILVDB_SHARED");
  return fs::weakly_canonical(folder ? fs::path(folder)
                                     : fs::path(SOILVDB_SOURCE_DIR) / "../shared");
}

class RealSite : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    if (!fs::exists(data_ / "dem/dtm.tif")) GTEST_SKIP() << "no " << data_;
  }
  Result good(const std::string& arguments) const {
    const Result result = run(arguments);
    EXPECT_EQ(result.status, 0) << arguments << ": " << result.err;
    EXPECT_EQ(result.err, "") << arguments;
    return result;
  }
  nlohmann::json good_json(const std::string& arguments) const {
    return nlohmann::json::parse(good(arguments).out, nullptr, false);
  }
  bool there_is(const std::string& program) const {
    return shell("command -v " + program).status == 0;
  }

  const fs::path data_ = shared() / "data";
};

}  // namespace soilvdb::test
