// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs that end early, and what they are once they have been gone on with.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/program.h"

namespace soilvdb::test {

class Resume : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_file(folder() / "dig.csv", HalfSine{}.csv(41));
    write_scenario("{plane: {z: 0}}");
  }

  void write_scenario(const std::string& terrain, const std::string& sync = "always") const {
    std::string text = half_sine_scenario(
        terrain, "dig.csv",
        fmt::format("{{snapshots: {{every: 1}}, mesh: ply, journal: {{sync: {}}}}}", sync));
    text.replace(text.find("0.025"), 5, "0.05");
    write_file(folder() / "dig.yaml", text);
  }
  void run_whole(const std::string& arguments = "dig.yaml") const {
    const Result result = run("run " + arguments);
    ASSERT_EQ(result.status, 0) << result.err;
    hash_ = summary()["state_hash"];
    cut_m3_ = summary()["volume_m3"]["cut"];
    rows_ = updates();
    mesh_ = read_file(out() / "soil_final.ply");
  }
  /// Makes of a run that came to its end one that ended earlier.
  void interrupt(double share) const {
    cut_journal(out() / "journal", share);
    for (const char* name : {"summary.json", "soil_final.vdb", "soil_final.ply", "updates.csv"})
      fs::remove(out() / name);
  }
  /// Makes a run that ended early, and knows what it would have been.
  void run_part(double share, const std::string& arguments = "dig.yaml") const {
    run_whole(arguments);
    interrupt(share);
  }
  void expect_same_as_whole() const {
    EXPECT_EQ(summary()["state_hash"], hash_);
    EXPECT_EQ(summary()["volume_m3"]["cut"], cut_m3_);
    EXPECT_EQ(updates(), rows_);
    EXPECT_EQ(read_file(out() / "soil_final.ply"), mesh_);
    EXPECT_EQ(run("verify out/dig").status, 0);
  }
  void expect_goes_on_to_the_same() const {
    good("resume out/dig");
    expect_same_as_whole();
  }

  fs::path out() const { return folder() / "out/dig"; }
  nlohmann::json summary() const { return read_json(out() / "summary.json"); }

  /// updates.csv without the last column, the time each took.
  std::vector<std::string> updates() const {
    std::vector<std::string> lines;
    std::istringstream csv(read_file(out() / "updates.csv"));
    for (std::string line; std::getline(csv, line);)
      lines.push_back(line.substr(0, line.rfind(',')));
    return lines;
  }
  void damage(const std::string& name, std::size_t at) const {
    std::string bytes = read_file(out() / name);
    bytes.at(at) = static_cast<char>(bytes[at] ^ 4);
    write_file(out() / name, bytes);
  }

  mutable std::string hash_, mesh_;
  mutable double cut_m3_ = 0;
  mutable std::vector<std::string> rows_;
};

}  // namespace soilvdb::test
