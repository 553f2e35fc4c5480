// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs of the half-sine dig.
#pragma once

#include "tests/support/program.h"

namespace soilvdb::test {

class Run : public ProgramTest {
 protected:
  static constexpr int kRows = 1001;  // chords cut (pi / 1000)^2 / 12 < 1e-6 of the volume short

  void SetUp() override {
    ProgramTest::SetUp();
    write_file(folder() / "dig.yaml", half_sine_scenario());
    write_file(folder() / "dig.csv", HalfSine{}.csv(kRows));
  }
  /// The summary of a run that must be good.
  nlohmann::json summary(const std::string& arguments, const std::string& out = "out/dig") const {
    const Result result = run("run " + arguments);
    EXPECT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(result.err, "");
    return read_json(folder() / out / "summary.json");
  }
};

}  // namespace soilvdb::test
