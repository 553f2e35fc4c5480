// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A command line in a folder with the half-sine dig.
#pragma once

#include "tests/support/program.h"

namespace soilvdb::test {

class CommandLine : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_file(folder() / "dig.yaml", half_sine_scenario());
    write_file(folder() / "dig.csv", HalfSine{}.csv(101));
  }
};

}  // namespace soilvdb::test
