// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs of scenarios whose soil moves: what they report, and that they come out the same however
// they were interrupted.
#include <cmath>
#include <sstream>

#include "tests/program.h"

namespace soilvdb::testing {
namespace {

using nlohmann::json;

constexpr const char* kSoil = "soil: {repose_angle: 0.61, swell: 0.25}\n";
constexpr const char* kDigger =
    "machines:\n  - name: digger\n    motion: dig.csv\n    bucket:\n      width: 1.2\n"
    "      height: 0.9\n"
    "      profile: [[0, 0], [-0.45, -0.1], [-0.85, 0.15], [-0.95, 0.55], [-0.7, 0.9], [0, 0.9]]\n";
constexpr const char* kPours =
    "pours:\n  - {name: truck, at: [4, 3, 2], time: [1, 5], volume: 0.4}\n"
    "  - {name: tip, at: [-3, 3, 2], time: [6.5, 6.5], volume: 0.1}\n";
constexpr const char* kHopper = "hoppers:\n  - {name: bed, box: [3, -2, 7, 2], top: 1}\n";

/// A dig along x that is curled up, carried and tipped at its end.
std::string dig_csv() {
  std::string text = "time,x,y,z,pitch\n";
  constexpr int kRows = 81;
  for (int i = 0; i < kRows; ++i) {
    const double t = 8.0 * i / (kRows - 1), s = std::min(1.0, t / 4);
    const double curl = std::max(0.0, (s - 0.7) / 0.3), down = std::min(1.0, s / 0.15);
    const double carried = std::clamp((t - 4) / 2, 0.0, 1.0);
    const double tip = std::clamp(t - 6, 0.0, 1.0);
    text += fmt::format("{},{},0,{},{}\n", t, 2 * std::min(s / 0.85, 1.0) + 3 * carried,
                        0.3 - 0.6 * down + 1.8 * std::max(0.0, (s - 0.8) / 0.2),
                        0.35 - 1.9 * curl + 3 * tip);
  }
  return text;
}

class EarthmovingRun : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_file(folder() / "dig.csv", dig_csv());
    write("all.yaml", std::string(kSoil) + kDigger + kPours + kHopper);
  }
  void write(const std::string& name, const std::string& text,
             const std::string& terrain = "{plane: {z: 0}}") const {
    write_file(folder() / name,
               fmt::format("soilvdb: 1\nname: site\nvoxel_size: 0.1\nterrain: {}\n{}"
                           "output: {{snapshots: {{every: 2}}, journal: {{sync: always}}}}\n",
                           terrain, text));
  }
  json summary(const std::string& arguments, const std::string& out) const {
    good(fmt::format("run {} --out {}", arguments, out));
    return read_json(folder() / out / "summary.json");
  }
  std::vector<std::vector<std::string>> rows(const std::string& out) const {
    std::istringstream lines(read_file(folder() / out / "updates.csv"));
    std::vector<std::vector<std::string>> all;
    for (std::string line; std::getline(lines, line);) {
      std::istringstream fields(line);
      for (all.emplace_back(); std::getline(fields, line, ',');) all.back().push_back(line);
    }
    return all;
  }
  /// All that a run says but for how long it took.
  std::string essence(const std::string& out) const {
    json summary = read_json(folder() / out / "summary.json");
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

TEST_F(EarthmovingRun, SaysWhereAllSoilWent) {
  const json s = summary("all.yaml", "out");
  const json &volume = s["volume_m3"], &mass = s["mass_kg"], &machine = s["machines"][0];
  EXPECT_EQ(mass["residual"], 0);
  EXPECT_EQ(volume["residual"], 0);
  for (const char* key : {"cut", "spilled", "poured", "hauled", "slid", "fill"})
    EXPECT_GT(volume[key], 0) << key;
  EXPECT_EQ(volume["dumped"], 0) << "no dump_angle";
  EXPECT_NEAR(volume["poured"], 0.5, 1e-6);
  EXPECT_NEAR(mass["poured"], 0.5 / 1.25 * 1800, 1e-3);
  EXPECT_NEAR(mass["hauled"].get<double>() / volume["hauled"].get<double>(), 1800 / 1.25, 1e-6);
  EXPECT_NEAR(mass["ground_change"].get<double>() + mass["buckets"].get<double>() +
                  mass["hauled"].get<double>() + mass["in_flight"].get<double>(),
              mass["poured"], 1e-6);
  EXPECT_GT(machine["capacity_m3"]["heaped"], machine["capacity_m3"]["struck"]);
  EXPECT_EQ(machine["bucket_kg"], mass["buckets"]);
}

TEST_F(EarthmovingRun, ARowOfUpdatesSaysWhatWasSpilledAndSlid) {
  const json s = summary("all.yaml", "out");
  const auto all = rows("out");
  EXPECT_EQ(all.front(),
            (std::vector<std::string>{"time", "machine", "cut_m3", "bucket_m3", "update_us",
                                      "bucket_kg", "spilled_m3", "slid_m3"}));
  EXPECT_EQ(static_cast<double>(all.size()), s["updates"].get<double>() + 1);
  double spilled = 0, last_s = 0;
  int poured = 0;
  for (std::size_t i = 1; i < all.size(); ++i) {
    spilled += std::stod(all[i].at(6));
    EXPECT_GE(std::stod(all[i][0]), last_s);
    last_s = std::stod(all[i][0]);
    if (all[i][1] == "digger") continue;
    EXPECT_TRUE(all[i][1] == "truck" || all[i][1] == "tip");
    EXPECT_EQ(all[i][2] + all[i][3] + all[i][5], "000");
    ++poured;
  }
  EXPECT_GT(poured, 10);
  EXPECT_NEAR(spilled, s["volume_m3"]["spilled"], 1e-3) << "but for what comes to rest at the end";
}

TEST_F(EarthmovingRun, RigidSoilSaysNothingOfIt) {
  write("rigid.yaml", kDigger);
  const json s = summary("rigid.yaml", "out");
  EXPECT_FALSE(s.contains("mass_kg"));
  EXPECT_FALSE(s["volume_m3"].contains("spilled"));
  EXPECT_FALSE(s["machines"][0].contains("bucket_kg"));
  EXPECT_EQ(rows("out").front().size(), 5);
}

TEST_F(EarthmovingRun, PoursNeedNoMachines) {
  write("pours.yaml", std::string(kSoil) + kPours);
  const json s = summary("pours.yaml", "out");
  EXPECT_EQ(s["mass_kg"]["residual"], 0);
  EXPECT_NEAR(s["volume_m3"]["fill"], 0.5 + s["volume_m3"]["slid"].get<double>(), 1e-2);
  EXPECT_EQ(s["acknowledged"]["time_s"], 6.5);
  good("verify out");
  EXPECT_NE(good("info out/soil_final.vdb").out.find("loose         0."), std::string::npos);
}

TEST_F(EarthmovingRun, AHopperTakesAllThatFallsIntoIt) {
  write("hopper.yaml", std::string(kSoil) +
                           "pours: [{name: truck, at: [5, 0, 3], time: [0, 2], volume: 0.3}]\n" +
                           kHopper);
  good("run hopper.yaml --out out");
  const json s = read_json(folder() / "out/summary.json");
  EXPECT_EQ(s["volume_m3"]["hauled"], s["volume_m3"]["poured"]);
  EXPECT_EQ(s["mass_kg"]["ground_change"], 0);
  EXPECT_EQ(s["mass_kg"]["residual"], 0);
}

TEST_F(EarthmovingRun, ThreadsMakeNoDifference) {
  summary("all.yaml --threads 1", "one");
  for (const char* threads : {"2", "4"}) {
    summary(fmt::format("all.yaml --threads {}", threads), "more" + std::string(threads));
    EXPECT_TRUE(essence("more" + std::string(threads)) == essence("one")) << threads;
  }
}

TEST_F(EarthmovingRun, UpdatesMakeHardlyADifferenceToTheLoad) {
  write("dig.yaml", std::string(kSoil) + kDigger);
  write_file(folder() / "dig.csv", [] {
    const std::string text = dig_csv();  // not tipped
    return text.substr(0, text.find("\n6.1,") + 1);
  }());
  const json few = summary("dig.yaml --updates 30", "few")["machines"][0];
  const json many = summary("dig.yaml --updates 2000", "many")["machines"][0];
  const double load = many["bucket_m3"];
  EXPECT_GT(load, 0.2);
  EXPECT_NEAR(few["bucket_m3"], load, 0.005 * load);
}

TEST_F(EarthmovingRun, ABucketThatIsNeverTippedIsWarnedOf) {
  write("dig.yaml", std::string(kSoil) + kDigger);
  std::string text = dig_csv();
  write_file(folder() / "dig.csv", text.substr(0, text.find("\n4.5,") + 1));
  EXPECT_NE(good("run dig.yaml --out out").err.find("never tipped"), std::string::npos);
  EXPECT_EQ(good("run all.yaml --out all").err.find("never tipped"), std::string::npos);
}

TEST_F(EarthmovingRun, GoesOnToTheSameBitsFromAnywhere) {
  summary("all.yaml", "out");
  const std::string whole = essence("out");
  for (const double share : {0.1, 0.35, 0.5, 0.8, 0.97}) {
    for (const bool snapshots : {true, false}) {
      SCOPED_TRACE(fmt::format("{} {}", share, snapshots));
      fs::remove_all(folder() / "cut");
      fs::copy(folder() / "out", folder() / "cut");
      if (!snapshots)
        for (const char* name : {"soil_2.vdb", "soil_4.vdb", "soil_6.vdb", "soil_8.vdb"})
          fs::remove(folder() / "cut" / name);
      cut_journal(folder() / "cut/journal", share);
      good("resume cut");
      EXPECT_TRUE(essence("cut") == whole);
      good("verify cut");
    }
  }
}

TEST_F(EarthmovingRun, WhatIsGoneOfAFinishedRunIsMadeAgain) {
  summary("all.yaml", "out");
  const std::string whole = essence("out");
  for (const char* name : {"soil_final.vdb", "updates.csv", "summary.json"}) {
    fs::remove(folder() / "out" / name);
    good("resume out");
    EXPECT_TRUE(essence("out") == whole) << name;
  }
}

#ifdef SOILVDB_IO_SHIM

TEST_F(EarthmovingRun, KilledAtAnyOperationItGoesOnToTheSameBits) {
  const auto launch = [&](const std::string& command, const std::string& out, int kill) {
    const std::string base = (folder() / out).string();
    return shell(fmt::format(
        "SHIM_FOLDER='{0}' SHIM_LOG='{0}.log' SHIM_FAULT='{1}' LD_PRELOAD='{2}' '{3}' {4} '{0}'",
        base, kill > 0 ? fmt::format("kill {}", kill) : "", SOILVDB_IO_SHIM, SOILVDB_PROGRAM,
        command));
  };
  const std::string run = "run all.yaml --threads 1 --updates 20 --out";
  EXPECT_EQ(launch(run, "out", 0).status, 0);
  const std::string whole = essence("out"), log = read_file(folder() / "out.log");
  const auto operations = static_cast<int>(std::count(log.begin(), log.end(), '\n'));
  ASSERT_GT(operations, 100);
  // The last ones are those of the files at the end, among them the ground at rest.
  std::vector<int> kills;
  for (int at = 5; at < operations - 30; at += operations / 8) kills.push_back(at);
  for (int at = operations - 30; at <= operations; at += 3) kills.push_back(at);
  for (const int at : kills) {
    SCOPED_TRACE(at);
    fs::remove_all(folder() / "cut");
    EXPECT_NE(launch(run, "cut", at).status, 0);
    const bool begun = fs::exists(folder() / "cut/journal");
    good(begun ? "resume cut" : run + " cut");
    EXPECT_TRUE(essence("cut") == whole);
  }
}

#endif

TEST_F(EarthmovingRun, LooseSoilStaysLooseInTheNextRun) {
  write("first.yaml", std::string(kSoil) + kPours);
  summary("first.yaml", "first");
  write("next.yaml",
        std::string(kSoil) + "pours: [{name: more, at: [4, 3, 2], time: [0, 1], volume: 0.1}]\n",
        "{level_set: first/soil_final.vdb}");
  const json s = summary("next.yaml", "next");
  EXPECT_EQ(s["mass_kg"]["residual"], 0);
  EXPECT_NEAR(s["mass_kg"]["ground_change"], 0.1 / 1.25 * 1800, 1);
  const std::string said = good("info next/soil_final.vdb").out;
  const std::size_t at = said.find("loose");
  ASSERT_NE(at, std::string::npos) << said;
  EXPECT_NEAR(std::stod(said.substr(at + 5)), 0.6, 0.01);
}

}  // namespace
}  // namespace soilvdb::testing
