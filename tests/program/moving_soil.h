// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs whose soil moves: a bucket that is filled, carried and tipped over a hopper and beside it,
// pours, and all that such a run says.
#pragma once

#include <string>
#include <vector>

#include "tests/support/program.h"

namespace soilvdb::test {

inline constexpr const char* kSoil = "soil: {repose_angle: 0.61, swell: 0.25}\n";
inline constexpr const char* kDigger =
    "machines:\n  - name: digger\n    motion: dig.csv\n    bucket:\n      width: 1.2\n"
    "      height: 0.9\n"
    "      profile: [[0, 0], [-0.45, -0.1], [-0.85, 0.15], [-0.95, 0.55], [-0.7, 0.9], [0, 0.9]]\n";
inline constexpr const char* kPours =
    "pours:\n  - {name: truck, at: [4, 3, 2], time: [1, 5], volume: 0.4}\n"
    "  - {name: tip, at: [-3, 3, 2], time: [6.5, 6.5], volume: 0.1}\n";
inline constexpr const char* kHopper = "hoppers:\n  - {name: bed, box: [4.4, -2, 7, 2], top: 1}\n";

/// A dig along x that is curled up, carried and tipped at its end.
/// @param curls else the bucket never turns, and is pulled up and let down again
inline std::string dig_csv(bool curls = true) {
  std::string text = "time,x,y,z,pitch\n";
  constexpr int kDigRows = 81;
  for (int i = 0; i < kDigRows; ++i) {
    const double t = 8.0 * i / (kDigRows - 1), s = std::min(1.0, t / 4);
    const double curl = std::max(0.0, (s - 0.7) / 0.3), down = std::min(1.0, s / 0.15);
    const double carried = std::clamp((t - 4) / 2, 0.0, 1.0);
    const double tip = std::clamp(t - 6, 0.0, 1.0);
    text += fmt::format(
        "{},{},0,{},{}\n", t, 2 * std::min(s / 0.85, 1.0) + 3 * carried,
        0.3 - 0.6 * down + 1.8 * std::max(0.0, (s - 0.8) / 0.2) - (curls ? 0 : 1.7 * tip),
        curls ? 0.35 - 1.9 * curl + 3 * tip : 0.35);
  }
  return text;
}

class MovingSoil : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_file(folder() / "dig.csv", dig_csv());
    write("all.yaml", std::string(kSoil) + kDigger + kPours + kHopper);
  }
  void write(const std::string& name, const std::string& text,
             const std::string& terrain = "{plane: {z: 0}}",
             const std::string& output = "{snapshots: {every: 2}, journal: {sync: always}}",
             double voxel_m = 0.1) const {
    write_file(folder() / name,
               fmt::format("soilvdb: 1\nname: site\nvoxel_size: {}\nterrain: {}\n{}output: {}\n",
                           voxel_m, terrain, text, output));
  }
  nlohmann::json summary(const std::string& arguments, const std::string& out) const {
    good(fmt::format("run {} --out {}", arguments, out));
    return read_json(folder() / out / "summary.json");
  }
  /// Fields of updates.csv.
  std::vector<std::vector<std::string>> rows(const std::string& out) const {
    std::istringstream lines(read_file(folder() / out / "updates.csv"));
    std::vector<std::vector<std::string>> all;
    for (std::string line; std::getline(lines, line);) {
      std::istringstream fields(line);
      for (all.emplace_back(); std::getline(fields, line, ',');) all.back().push_back(line);
    }
    return all;
  }
  /// All that a run says of the ground and of where soil went, however many updates it made.
  std::string state(const std::string& out) const {
    const nlohmann::json all = read_json(folder() / out / "summary.json");
    nlohmann::json some;
    for (const char* key : {"volume_m3", "mass_kg", "machines", "soil", "state_hash"})
      some[key] = all.at(key);
    return some.dump(1) + read_file(folder() / out / "soil_final.vdb");
  }
  /// All that a run says but for how long it took, what memory and on how many threads.
  std::string essence(const std::string& out) const {
    nlohmann::json summary = read_json(folder() / out / "summary.json");
    for (const char* key : {"update_us", "wall_s", "memory_bytes", "threads"}) summary.erase(key);
    std::string text = summary.dump(1);
    for (std::vector<std::string>& row : rows(out)) {
      row.at(4).clear();
      for (const std::string& field : row) text += field + ',';
      text += '\n';
    }
    return text + read_file(folder() / out / "soil_final.vdb") +
           read_file(folder() / out / "soil_4.vdb");
  }
};

}  // namespace soilvdb::test
