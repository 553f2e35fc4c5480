// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs of a motion with rows put into it that are nonsense, beside the run without them.
#pragma once

#include <gtest/gtest.h>

#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/program.h"

namespace soilvdb::test {

class BadRows : public ProgramTest {
 protected:
  static constexpr int kRows = 41;

  void SetUp() override {
    ProgramTest::SetUp();
    write_file(folder() / "clean.csv", HalfSine{}.csv(kRows));
    std::istringstream csv(HalfSine{}.csv(kRows));
    for (std::string line; std::getline(csv, line);) lines_.push_back(line + '\n');
    write_scenario("clean.yaml", "clean.csv", "stop");
  }
  void write_scenario(const std::string& name, const std::string& motion,
                      const std::string& policy) const {
    std::string text =
        half_sine_scenario("{plane: {z: 0}}", motion + "\n    bad_rows: " + policy,
                           "{snapshots: {every: 1}, mesh: ply, raster: {cell: 0.1}}");
    text.replace(text.find("0.025"), 5, "0.05");
    write_file(folder() / name, text);
  }
  /// The motion with more lines, each in front of one of its rows (1..kRows; kRows + 1: the end).
  std::string with(const std::vector<std::pair<std::size_t, std::string>>& more) const {
    std::string text;
    for (std::size_t i = 0; i <= lines_.size(); ++i) {
      for (const auto& [row, line] : more) text += row == i ? line + '\n' : "";
      if (i < lines_.size()) text += lines_[i];
    }
    return text;
  }
  nlohmann::json summary(const std::string& out) const {
    return read_json(folder() / out / "summary.json");
  }
  /// updates.csv without the last column, the time each took.
  std::string updates(const std::string& out) const {
    std::istringstream csv(read_file(folder() / out / "updates.csv"));
    std::string text;
    for (std::string line; std::getline(csv, line);) text += line.substr(0, line.rfind(',')) + '\n';
    return text;
  }
  void expect_same(const std::string& out, const std::string& expected) const {
    for (const char* key : {"state_hash", "volume_m3", "updates", "soil"})
      EXPECT_EQ(summary(out)[key], summary(expected)[key]) << key;
    EXPECT_EQ(updates(out), updates(expected));
    for (const char* name : {"soil_final.ply", "soil_final.tif"})
      EXPECT_EQ(read_file(folder() / out / name), read_file(folder() / expected / name)) << name;
  }

  std::vector<std::string> lines_;  ///< header, rows
};

}  // namespace soilvdb::test
