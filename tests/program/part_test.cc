// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A scenario dug in parts and merged is what one process digs, bit for bit; what can't be is
// refused.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/program.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace part_test {

constexpr const char* kArm = R"(<robot name="arm">
  <link name="base"/> <link name="boom"/> <link name="lip"/>
  <joint name="lift" type="revolute"><parent link="base"/><child link="boom"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="0" velocity="1"/></joint>
  <joint name="lip_frame" type="fixed"><parent link="boom"/><child link="lip"/>
    <origin xyz="2 0 0" rpy="0 0 3.14159"/></joint>
</robot>
)";

struct Place {
  double x_m = 0, y_m = 0;
};

class Part : public ProgramTest {
 protected:
  /// Digs cycles of ten seconds from `begin_s` on, each at the next of the places, and drives on in
  /// between. Every other load is carried through a cycle before it is dumped.
  std::string cycles(const std::vector<Place>& places, double begin_s = 0, int rows = 21) const {
    constexpr double kDigs = 0.7, kPi = std::numbers::pi;  // share of a cycle
    const auto from = [&](std::size_t c) {
      const Place& at = places[std::min(c, places.size() - 1)];
      return Place{at.x_m + 0.13 * static_cast<double>(c % 5), at.y_m};
    };
    std::string text = "time,x,y,z,pitch\n";
    for (std::size_t c = 0; c < places.size(); ++c) {
      for (int i = 0; i < rows - 1; ++i) {
        const double s = static_cast<double>(i) / (rows - 1);
        const double digs = std::min(s / kDigs, 1.0), goes = std::max(s - kDigs, 0.0) / (1 - kDigs);
        const Place to{from(c + 1).x_m - from(c).x_m - 2, from(c + 1).y_m - from(c).y_m};
        text += fmt::format("{:.6f},{:.4f},{:.4f},{:.4f},{:.4f}\n",
                            begin_s + 10 * (static_cast<double>(c) + s),
                            from(c).x_m + 2 * digs + to.x_m * goes,
                            from(c).y_m + 0.3 * std::sin(2 * kPi * s) + to.y_m * goes,
                            0.3 - 0.9 * std::sin(kPi * digs) + 0.6 * std::sin(kPi * goes),
                            0.1 + (c % 2 ? 1.2 : 0.0) * std::sin(kPi * goes));
      }
    }
    return text;
  }
  void add(const std::string& name, const std::string& motion) {
    write_file(folder() / (name + ".csv"), motion);
    machines_ += fmt::format(
        "  - {{name: {}, bucket: {{width: 0.8, height: 0.6, dump_angle: 1.0}}, motion: {}.csv}}\n",
        name, name);
  }
  void write(const std::string& more = "output: {mesh: ply, raster: {cell: 0.2}}\n",
             const std::string& terrain = "{plane: {z: 0.05, slope: [0.02, -0.01]}}") const {
    write_file(folder() / "site.yaml",
               fmt::format("soilvdb: 1\nname: site\nvoxel_size: 0.1\nterrain: {}\nmachines:\n{}{}",
                           terrain, machines_, more));
  }
  /// Two that dig where the other is, at another time, with both on their way in between.
  void add_crossing() {
    std::vector<Place> there(12, Place{0, 0}), back(12, Place{14, 3});
    std::swap_ranges(there.begin() + 6, there.end(), back.begin() + 6);
    add("a", cycles(there));
    add("b", cycles(back));
  }

  /// @return the plan
  nlohmann::json plan(int parts, const std::string& options = "") const {
    good(fmt::format("part plan site.yaml --out split --parts {} {}", parts, options));
    return read_json(folder() / "split/plan.json");
  }
  void dig(std::size_t window, std::size_t part) const {
    good(fmt::format("part dig split --window {} --part {}", window, part));
    const auto summary =
        read_json(folder() / fmt::format("split/parts/{}_{}/summary.json", window, part));
    EXPECT_NEAR(summary["volume_m3"]["residual"].get<double>(), 0, 1e-9);
  }
  void dig_window(const nlohmann::json& plan, std::size_t window) const {
    for (std::size_t p = plan["windows"][window]["parts"].size(); p-- > 0;) dig(window, p);
  }
  void split(const nlohmann::json& plan) const {
    for (std::size_t w = 0; w < plan["windows"].size(); ++w) {
      dig_window(plan, w);
      good(fmt::format("part merge split --window {}", w));
    }
    good("resume split");
  }

  std::vector<std::string> updates(const std::string& folder_name) const {
    std::vector<std::string> lines;
    std::istringstream csv(read_file(folder() / folder_name / "updates.csv"));
    for (std::string line; std::getline(csv, line);)
      lines.push_back(line.substr(0, line.rfind(',')));
    return lines;
  }
  void expect_same_as_one_process(const std::string& options = "") const {
    good("run site.yaml --out whole --threads 1 " + options);
    const auto whole = read_json(folder() / "whole/summary.json");
    const auto parts = read_json(folder() / "split/summary.json");
    ASSERT_GT(whole["volume_m3"]["cut"].get<double>(), 0.1);
    for (const char* key : {"state_hash", "volume_m3", "machines", "soil", "files"})
      EXPECT_EQ(parts[key], whole[key]) << key;
    EXPECT_EQ(updates("split"), updates("whole"));
    for (const char* name : {"soil_final.vdb", "soil_final.ply", "soil_final.tif"})
      EXPECT_TRUE(read_file(folder() / "split" / name) == read_file(folder() / "whole" / name))
          << name;
    good("verify split");
    EXPECT_NE(good("resume split").out.find("the run is finished"), std::string::npos);
  }

  std::string machines_;
};

TEST_F(Part, AShiftOfTenInEightIsWhatOneProcessDigs) {
  for (int m = 0; m < 10; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(3, {12.0 * (m % 5), 12.0 * (m / 5)})));
  write();
  const auto made = plan(8);
  EXPECT_EQ(made["windows"].size(), 1u) << "they are apart all the time";
  EXPECT_EQ(made["windows"][0]["parts"].size(), 8u);
  split(made);
  expect_same_as_one_process();
}

TEST_F(Part, ThreePartsOfSevenShareTheMachines) {
  for (int m = 0; m < 7; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(2, {12.0 * m, 0}), 1.7 * m));
  write();
  const auto made = plan(3, "--updates 33");
  std::size_t machines = 0;
  for (const auto& part : made["windows"][0]["parts"]) machines += part["machines"].size();
  EXPECT_EQ(machines, 7u);
  split(made);
  expect_same_as_one_process("--updates 33");
}

TEST_F(Part, TheLongestMotionIsAPartByItself) {
  for (int m = 0; m < 5; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(m == 4 ? 4 : 1, {12.0 * m, 0})));
  write();
  const std::string said = good("part plan site.yaml --out split --parts 2").out;
  EXPECT_NE(said.find("in 2 parts in 1 window; at best 2 times as fast"), said.npos) << said;
}

TEST_F(Part, MachinesThatDigInOneChunkAreOnePart) {
  // Chunks are 0.8 m, the ways 1.65 m apart, and what is cut of them 0.75 m.
  for (const double y_m : {-0.49, -0.47, -0.45}) {
    machines_.clear();
    add("a", cycles(std::vector<Place>(2, Place{0, y_m})));
    add("b", cycles(std::vector<Place>(2, Place{0, y_m + 1.65})));
    for (auto at = machines_.find("width: 0.8, height: 0.6"); at != machines_.npos;
         at = machines_.find("width: 0.8, height: 0.6"))
      machines_.replace(at, 23, "width: 0.3, height: 0.2");
    write();
    expect_refused("part plan site.yaml --out split --parts 2", "a and b from 0 to ");
  }
}

TEST_F(Part, PlanAndScenarioMayBeMovedTogether) {
  for (int m = 0; m < 2; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(2, {12.0 * m, 0})));
  write();
  plan(2);
  fs::create_directory(folder() / "moved");
  for (const char* name : {"site.yaml", "m0.csv", "m1.csv", "split"})
    fs::rename(folder() / name, folder() / "moved" / name);
  for (int p = 0; p < 2; ++p) good(fmt::format("part dig moved/split --window 0 --part {}", p));
  good("part merge moved/split --window 0");
}

TEST_F(Part, MachinesThatCrossAtOtherTimesAreApartInWindows) {
  for (const char* options : {"--updates 100", "", "--voxel 0.07"}) {
    if (!test::kLong && *options == 0) continue;
    SCOPED_TRACE(options);
    for (const char* name : {"split", "whole"}) fs::remove_all(folder() / name);
    machines_.clear();
    add_crossing();
    write();
    const auto made = plan(2, options);
    ASSERT_GT(made["windows"].size(), 1u);
    split(made);
    expect_same_as_one_process(options);
    // One carried a load over a border, and dumped it in another window.
    const double border_s = made["windows"][0]["end_s"];
    double load_m3 = 0;
    for (const std::string& line : updates("whole")) {
      if (line.starts_with("time") || std::stod(line) > border_s) continue;
      load_m3 = std::stod(line.substr(line.rfind(',') + 1));
    }
    EXPECT_GT(load_m3, 0.01);
  }
}

TEST_F(Part, MachinesMayBeginLateAndEndEarly) {
  add("early", cycles(std::vector<Place>(3, Place{0, 0})));
  add("late", cycles(std::vector<Place>(5, Place{1, 0}), 47.3));
  add("all", cycles(std::vector<Place>(9, Place{20, 0}), -5));
  write();
  const auto made = plan(4);
  split(made);
  expect_same_as_one_process();
}

TEST_F(Part, LongMotionsComeInPiecesInWindowsToo) {
  add_crossing();
  std::vector<Place> there(20, Place{0, 30}), back(20, Place{14, 30});
  std::swap_ranges(there.begin() + 10, there.end(), back.begin() + 10);
  add("c", cycles(there, 0, 1001));  // 20 000 rows, of which 16384 are in memory
  add("d", cycles(back, 0, 1001));
  write();
  const auto made = plan(4, "--updates 77");
  ASSERT_GT(made["windows"].size(), 1u);
  split(made);
  expect_same_as_one_process("--updates 77");
}

TEST_F(Part, SnapshotsOnTheWayAreNotMadeAndThoseOfThePartsGoOnFromASnapshot) {
  add_crossing();
  write();
  good("run site.yaml --out before");
  write("output: {snapshots: {every: 7, incremental: true}}\n",
        "{level_set: before/soil_final.vdb}");
  split(plan(2));
  good("run site.yaml --out whole");
  const auto whole = read_json(folder() / "whole/summary.json");
  const auto parts = read_json(folder() / "split/summary.json");
  EXPECT_EQ(parts["state_hash"], whole["state_hash"]);
  EXPECT_EQ(parts["volume_m3"], whole["volume_m3"]);
  EXPECT_EQ(parts["files"].size(), 4u) << parts["files"];
}

TEST_F(Part, APartThatWasKilledGoesOn) {
  add_crossing();
  write();
  const auto made = plan(2);
  const fs::path last = folder() / fmt::format("split/parts/{}_0", made["windows"].size() - 1);
  for (std::size_t w = 0; w < made["windows"].size(); ++w) {
    dig_window(made, w);
    for (const double share : {0.6, 0.0}) {
      const fs::path part = folder() / fmt::format("split/parts/{}_0", w);
      cut_journal(part / "journal", share);
      for (const char* name : {"summary.json", "soil_final.vdb", "updates.csv"})
        fs::remove(part / name);
      const std::string merge = fmt::format("part merge split --window {}", w);
      bad(merge, "isn't finished");
      good(fmt::format("verify split/parts/{}_0", w));
      dig(w, 0);
    }
    good(fmt::format("part merge split --window {}", w));
    good(fmt::format("part merge split --window {}", w));  // once more is nothing
  }
  good("resume split");
  expect_same_as_one_process();
}

TEST_F(Part, MotionsMayGrowMeanwhile) {
  for (int m = 0; m < 2; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(2, {12.0 * m, 0})));
  write();
  plan(2);
  dig(0, 0);
  const fs::path part = folder() / "split/parts/0_0";
  cut_journal(part / "journal", 0.5);
  for (const char* name : {"summary.json", "soil_final.vdb", "updates.csv"})
    fs::remove(part / name);
  write_file(folder() / "m1.csv", cycles(std::vector<Place>(4, {12.0, 0})));
  dig(0, 0);
  dig(0, 1);
  good("part merge split --window 0");
  good("resume split");
  expect_same_as_one_process();
}

TEST_F(Part, WhatIsDamagedIsNotMerged) {
  for (int m = 0; m < 2; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(2, {12.0 * m, 0})));
  write();
  const auto made = plan(2);
  dig_window(made, 0);
  const fs::path file = folder() / "split/parts/0_1/soil_final.vdb";
  const std::string intact = read_file(file);
  std::string bytes = intact;
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 4);
  write_file(file, bytes);
  bad("part merge split --window 0", "soil_final.vdb is damaged");
  dig(0, 1);
  EXPECT_TRUE(read_file(file) == intact);
  // A motion that is another by now.
  const std::string motion = read_file(folder() / "m1.csv");
  write_file(folder() / "m1.csv", "time,x,y,z,pitch\n0.01,12,0,0,0\n1,13,0,0,0\n");
  bad("part merge split --window 0", "have changed since it was split");
  EXPECT_FALSE(fs::exists(folder() / "split/journal"));
  write_file(folder() / "m1.csv", motion);
  good("part merge split --window 0");
  good("resume split");
  expect_same_as_one_process();
}

TEST_F(Part, WhatChangesBetweenPlanAndMergeIsRefused) {
  write_file(folder() / "arm.urdf", kArm);
  write_file(folder() / "arm.csv", "time,lift\n0,0\n9,0.9\n");
  write_file(folder() / "arm.yaml", "");
  add("a", cycles(std::vector<Place>(2, Place{0, 0})));
  machines_ +=
      "  - {name: arm, bucket: {width: 0.8, height: 0.6}, motion: arm.csv, urdf: arm.urdf, "
      "lip: {link: lip}, base: {xyz: [40, 0, 0.2]}}\n";
  write_file(
      folder() / "site.asc", "ncols 60\nnrows 20\nxllcorner -5\nyllcorner -10\ncellsize 1\n" + [] {
        std::string rows;
        for (int i = 0; i < 20; ++i) {
          for (int k = 0; k < 60; ++k) rows += k ? " 0.1" : "0.1";
          rows += "\n";
        }
        return rows;
      }());
  write("output: {mesh: ply, raster: {cell: 0.2}}\n", "{raster: site.asc}");
  plan(2);
  dig(0, 0);
  const auto changed = [&](const char* name, const std::string& from, const std::string& to) {
    const std::string before = read_file(folder() / name);
    std::string text = before;
    ASSERT_NE(text.find(from), std::string::npos) << name;
    write_file(folder() / name, text.replace(text.find(from), from.size(), to));
    for (const char* work : {"dig split --window 0 --part 1", "merge split --window 0"}) {
      expect_refused(fmt::format("part {}", work), name);
      expect_refused(fmt::format("part {}", work), "has changed since it was split");
    }
    expect_refused("part plan site.yaml --out split --parts 2", "split");
    write_file(folder() / name, before);
  };
  changed("site.yaml", "dump_angle: 1.0", "dump_angle: 0.5");
  changed("site.asc", "0.1", "0.2");
  changed("arm.urdf", "0 0 0.4", "0 0 0.5");
  dig(0, 1);
  good("part merge split --window 0");
  good("resume split");
  expect_same_as_one_process();
}

TEST_F(Part, WhatAnotherSplitLeftIsNotTakenForThisOne) {
  for (int m = 0; m < 2; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(2, {12.0 * m, 0})));
  write();
  const auto made = plan(2);
  dig(0, 0);
  const fs::path split = folder() / "split";
  fs::rename(split / "plan.json", folder() / "before.json");
  expect_refused("part plan site.yaml --out split --parts 2 --voxel 0.2",
                 "split/parts/0_0: is of a split whose plan is gone");
  fs::rename(folder() / "before.json", split / "plan.json");
  good("part plan site.yaml --out other --parts 2 --voxel 0.2");
  good("part dig other --window 0 --part 1");
  fs::rename(folder() / "other/parts/0_1", split / "parts/0_1");
  for (const char* work : {"dig split --part 1", "merge split"})
    expect_refused(fmt::format("part {}", work), "0_1: holds a run of something else");
  fs::remove_all(split / "parts/0_1");
  dig(0, 1);
  good("part merge split --window 0");
  good("resume split");
  expect_same_as_one_process();
}

TEST_F(Part, AnotherMemoryIsThatOfPartsToCome) {
  for (int m = 0; m < 2; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(2, {12.0 * m, 0})));
  write();
  plan(2, "--memory 64");
  EXPECT_EQ(plan(2, "--memory 32")["memory_mb"], 32);
  EXPECT_EQ(plan(2)["memory_mb"], 32);
}

TEST_F(Part, ARecordingIsThatOfOneProcess) {
  for (int m = 0; m < 2; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(2, {12.0 * m, 0})));
  write("output: {mesh: ply, raster: {cell: 0.2}, mcap: true, journal: {sync: always}}\n");
  const Result planned = run("part plan site.yaml --out split --parts 2");
  EXPECT_NE(planned.err.find("'output: mcap'"), std::string::npos) << planned.err;
  split(read_json(folder() / "split/plan.json"));
  EXPECT_FALSE(fs::exists(folder() / "split/parts/0_0/soil.mcap"));
  expect_same_as_one_process();
  EXPECT_TRUE(read_file(folder() / "split/soil.mcap") == read_file(folder() / "whole/soil.mcap"));
}

TEST_F(Part, TwoPartsThatChangedOneChunkAreRefused) {
  add("a", cycles(std::vector<Place>(2, Place{0, 0})));
  add("b", cycles(std::vector<Place>(2, Place{12, 0})));
  write();
  plan(2);
  dig(0, 0);
  // The other's motion comes to the same ground by now.
  write_file(folder() / "b.csv", cycles(std::vector<Place>(2, Place{1, 0})));
  dig(0, 1);
  const Result result = bad("part merge split --window 0", "both changed the ground at");
  EXPECT_NE(result.err.find("parts/0_0"), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("parts/0_1"), std::string::npos) << result.err;
  EXPECT_FALSE(fs::exists(folder() / "split/journal"));
}

TEST_F(Part, WhatCantBeSplitIsRefusedWithWhy) {
  const std::string arguments = "part plan site.yaml --out split --parts 4";
  add("a", cycles({{0, 0}, {0, 0}}));
  write();
  expect_refused(arguments, "site.yaml: can't be split: it has one machine");
  add("b", cycles({{1, 1}, {1, 1}}));
  write();
  expect_refused(arguments, "a and b from 0 to ");
  write("soil: {repose_angle: 0.6}\n");
  expect_refused(arguments, "it has 'soil:'");
  machines_.clear();
  add("a", cycles({{0, 0}, {0, 0}}));
  add("later", cycles({{0, 0}, {0, 0}}, 100));
  write();
  expect_refused(arguments, "no two of its machines work at the same time");
}

TEST_F(Part, AFolderOfSomethingElseIsLeftAlone) {
  for (int m = 0; m < 2; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(2, {12.0 * m, 0})));
  write();
  plan(2);
  EXPECT_EQ(plan(2), plan(2));
  expect_refused("part plan site.yaml --out split --parts 3", "--parts was another");
  expect_refused("part plan site.yaml --out split --parts 2 --voxel 0.2", "--voxel was another");
  write("output: {raster: {cell: 0.5}}\n");
  expect_refused("part plan site.yaml --out split --parts 2", "output.mesh");
  good("run site.yaml --out whole");
  expect_refused("part plan site.yaml --out whole --parts 2", "holds a run");
  write_file(folder() / "mine/soil_final.vdb", "of another program");
  expect_refused("part plan site.yaml --out mine --parts 2", "mine: holds soil_final.vdb");
  write_file(folder() / "spare/parts/list.txt", "of an excavator");
  expect_refused("part plan site.yaml --out spare --parts 2", "spare/parts/list.txt: is in the");
  expect_refused("part dig whole", "holds no plan");
  write();
  expect_refused("part dig split --window 1", "no part 0 of window 1");
  expect_refused("part merge split --window 1", "its plan has no window 1");
}

TEST_F(Part, AWrongCommandLineIsRefused) {
  for (int m = 0; m < 2; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(2, {12.0 * m, 0})));
  write();
  for (const char* voxel : {"nan", "inf", "0", "-0.1", "5cm"})
    expect_refused(fmt::format("part plan site.yaml --out split --parts 2 --voxel={}", voxel),
                   "--voxel: Value");
  for (const char* parts : {"0", "1", "-3"})
    expect_refused(fmt::format("part plan site.yaml --out split --parts={}", parts),
                   "--parts N, of 2 or more");
}

TEST_F(Part, APathThatIsNoTextIsRefused) {
  for (int m = 0; m < 2; ++m)
    add(fmt::format("m{}", m), cycles(std::vector<Place>(2, {12.0 * m, 0})));
  write();
  fs::rename(folder() / "site.yaml", folder() / "site\xff.yaml");
  expect_refused("part plan 'site\xff.yaml' --out split --parts 2", "no UTF-8 text");
}

}  // namespace part_test
}  // namespace soilvdb::test
