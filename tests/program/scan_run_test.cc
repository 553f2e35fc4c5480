// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scans in a scenario: what they correct, how a run goes on, and what is refused.
#include <fmt/format.h>

#include <random>

#include "tests/program/resume_fixture.h"

namespace soilvdb::test {
namespace scan_run_test {

class ScanRun : public Resume {
 protected:
  /// A dig on a plane whose lip is told 3 cm too high, and two scans of the true ground: of the
  /// plane beside it and of the floor 3 cm deeper than the machine says.
  void SetUp() override {
    Resume::SetUp();
    std::string csv = "time,x,y,z\n";
    for (int i = 0; i <= 40; ++i)
      csv += fmt::format("{},{},0,{}\n", 0.1 * i, 0.05 * i, i < 5 ? 0.2 - 0.08 * i : -0.2);
    csv += "4.5,4,3,2\n5,4,3,2\n";
    write_file(folder() / "dig.csv", csv);
    std::mt19937_64 random(1);
    std::normal_distribution<double> noise(0, 0.005);
    std::string points = "x,y,z\n";
    for (double x = -1; x < 3; x += 0.02)
      for (double y = -1.5; y < 1.5; y += 0.02) {
        const bool floor = x > 0.4 && x < 1.9 && std::abs(y) < 0.5;
        if (floor || std::abs(y) > 0.8)
          points +=
              fmt::format("{:.4f},{:.4f},{:.4f}\n", x, y, (floor ? -0.23 : 0) + noise(random));
      }
    write_file(folder() / "floor.csv", points);
    write(kScans);
  }
  static constexpr const char* kScans =
      "sensors:\n  mast: {at: [1, -4, 4], noise: {range: 0.005}}\n"
      "scans:\n"
      "  - {sensor: mast, file: floor.csv, time: 4.8, frame: world}\n"
      "  - {sensor: mast, file: floor.csv, time: 4.9, frame: world}\n";

  void write(const std::string& scans, const std::string& known = "") const {
    write_file(folder() / "dig.yaml",
               fmt::format("soilvdb: 1\nvoxel_size: 0.05\nterrain: {{plane: {{z: 0}}}}\n"
                           "machines:\n  - name: digger\n    bucket: {{width: 1.2, height: 0.9}}\n"
                           "    motion: dig.csv\n{}"
                           "{}output: {{snapshots: {{every: 1}}, mesh: ply, journal: {{sync: "
                           "always}}}}\n",
                           known, scans));
  }
  void expect_refused_line(const std::string& scans, const std::string& words) const {
    write(scans);
    const Result result = run("run dig.yaml");
    EXPECT_EQ(result.status, 2) << scans;
    EXPECT_NE(result.err.find(words), std::string::npos) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_FALSE(fs::exists(out()));
  }
};

TEST_F(ScanRun, CorrectsTheFloorAndFindsTheLip) {
  const Result result = good("run dig.yaml");
  EXPECT_NE(result.out.find("surveyed"), std::string::npos) << result.out;
  const nlohmann::json all = summary(), volumes = all["volume_m3"];
  // 1.5 m x 1 m of floor, 3 cm deeper.
  EXPECT_NEAR(volumes["surveyed_removed"].get<double>(), 0.045, 0.01);
  EXPECT_LT(volumes["surveyed_added"].get<double>(), 0.005);
  EXPECT_NEAR(volumes["residual"].get<double>(), 0, 1e-9);
  const nlohmann::json lip = all["machines"][0]["lip_error_m"];
  EXPECT_NEAR(lip["mean"].get<double>(), 0.03, 0.012);
  EXPECT_GT(lip["sigma"].get<double>(), 0.002);
  EXPECT_LT(lip["sigma"].get<double>(), 0.01);
  EXPECT_EQ(updates().size(), 44u) << "a row for each of the machine's, and the heading";
}

TEST_F(ScanRun, GoesOnFromAnyPlace) {
  for (const double share : {0.5, 0.99}) {
    run_part(share);
    expect_goes_on_to_the_same();
    fs::remove_all(out());
  }
}

TEST_F(ScanRun, TakesWhatIsKnownOfTheLip) {
  write(kScans, "    known: {lip: 0.001}\n");
  good("run dig.yaml");
  const nlohmann::json lip = summary()["machines"][0]["lip_error_m"];
  EXPECT_LT(std::abs(lip["mean"].get<double>()), 0.003);
}

TEST_F(ScanRun, RefusesWhatIsNoScan) {
  expect_refused_line("scans:\n  - {sensor: mast, file: floor.csv, time: 1}\n",
                      "dig.yaml:9: there is no sensor 'mast'");
  expect_refused_line("sensors: {mast: {at: [0, 0, 4], noise: {range: -1}}}\n", "range is -1");
  expect_refused_line("sensors: {mast: {at: [0, 0, 4], mast: 3}}\n", "unknown");
  expect_refused_line("sensors: {mast: {machine: diger}}\n", "there is no machine 'diger'");
  expect_refused_line("sensors: {mast: {machine: digger, link: boom}}\n", "no 'urdf'");
  expect_refused_line(
      "sensors: {mast: {at: [0, 0, 4]}}\nscans:\n  - {sensor: mast, file: none.ply, time: 1}\n",
      "none.ply");
  expect_refused_line(
      "sensors: {mast: {at: [0, 0, 4]}}\nscans:\n  - {sensor: mast, file: "
      "floor.csv, time: 1, frame: lidar}\n",
      "it must be world or sensor");
}

}  // namespace scan_run_test
}  // namespace soilvdb::test
