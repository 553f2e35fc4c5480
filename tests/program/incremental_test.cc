// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs with incremental snapshots: the ground of whole ones at a cost that goes with what changed.
#include <random>
#include <set>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "tests/program/incremental_fixture.h"

namespace soilvdb::test {
namespace incremental_test {

TEST_F(Incremental, SnapshotsAreTheGroundOfWholeOnesWithAnyThreads) {
  run_with("every: 1", "whole");
  run_with("every: 1, incremental: true", "one", "--threads 1");
  run_with("every: 1, incremental: true", "two", "--threads 2");
  const std::vector<io::JournalFile> files = snapshots("one");
  ASSERT_EQ(files.size(), snapshots("whole").size());
  EXPECT_EQ(read_json(folder() / "one/summary.json")["files"],
            read_json(folder() / "whole/summary.json")["files"]);
  EXPECT_TRUE(vdb_files("one") == vdb_files("two"));
  for (const io::JournalFile& file : files) {
    EXPECT_EQ(hash("one/" + file.name), hash("whole/" + file.name)) << file.name;
  }
  EXPECT_EQ(hash("one/soil_final.vdb"), hash("whole/soil_final.vdb"));
}

TEST_F(Incremental, TheirSurfaceIsThatOfWholeOnes) { expect_surfaces_of_whole_ones(); }

TEST_F(Incremental, TheirSurfaceIsThatOfWholeOnesInADeepPitOfRoughGround) {
  // Layer below layer, so that what was dug before lies at any distance above what is dug now.
  std::mt19937 random(3);
  std::vector<float> heights(41 * 41);
  for (float& z : heights) z = static_cast<float>(random() % 1024) / 1024 - 0.5f;
  io::write_geotiff(folder() / "rough.tif", {41, 41, {-4, -4}, {0.25, 0.25}}, {{"z", heights}}, "");
  terrain_ = "{raster: rough.tif}";
  std::string csv = "time,x,y,z\n";
  for (int pass = 0, row = 0; pass < 8; ++pass) {
    for (int i = 0; i <= 10; ++i, ++row)
      csv += fmt::format("{},{},0,{}\n", row / 5.0, 0.15 * (pass % 2 ? 10 - i : i),
                         0.3 - 0.25 * pass - 0.2 * std::sin(std::numbers::pi * i / 10));
  }
  write_file(folder() / "dig.csv", csv);
  expect_surfaces_of_whole_ones();
}

TEST_F(Incremental, AWholeOneComesWhenTheOthersHaveComeToTheGroundItself) {
  run_with("every: 1, incremental: true", "dig");
  std::size_t incremental = 0;
  const std::vector<io::JournalFile> files = snapshots("dig");
  for (const io::JournalFile& file : files) {
    io::SnapshotInfo info;
    const io::Site site = io::read_snapshot(folder() / "dig" / file.name, &info);
    ASSERT_EQ(info.parent.has_value(), !file.parent.empty());
    if (!info.parent) continue;
    ++incremental;
    EXPECT_LE(info.parent->depth, io::kMaxChainLength);
    EXPECT_LT(info.parent->chunks, site.ground->chunk_count()) << file.name;
  }
  EXPECT_GT(incremental, files.size() / 2);
  EXPECT_LT(incremental, files.size() - 1);
}

TEST_F(Incremental, SnapshotsAreReadByAllCommands) {
  run_with("every: 1", "whole");
  run_with("every: 1, incremental: true", "dig");
  const auto files = snapshots("dig");
  const auto it =
      std::find_if(files.rbegin(), files.rend(), [](const auto& f) { return !f.parent.empty(); });
  ASSERT_NE(it, files.rend());
  const std::string file = it->name, since = it->parent;
  const Result info = run("info dig/" + file);
  EXPECT_NE(info.out.find("goes on from  " + since), std::string::npos) << info.out;
  const auto same = [&](const std::string& command) {
    const Result inc = run(fmt::format(fmt::runtime(command), "dig/" + file));
    const Result whole = run(fmt::format(fmt::runtime(command), "whole/" + file));
    EXPECT_EQ(inc.status, 0) << inc.err;
    return std::pair{inc.out, whole.out};
  };
  const auto [diff, diff_whole] = same("diff --json whole/soil_1.vdb {}");
  auto numbers = nlohmann::json::parse(diff), expected = nlohmann::json::parse(diff_whole);
  for (auto* json : {&numbers, &expected}) json->erase("after");
  EXPECT_EQ(numbers, expected);
  EXPECT_EQ(run("export dig/" + file + " --to a.ply").status, 0);
  EXPECT_EQ(run("export whole/" + file + " --to b.ply").status, 0);
  EXPECT_TRUE(read_file(folder() / "a.ply") == read_file(folder() / "b.ply"));
  EXPECT_EQ(run("verify dig/" + file).status, 0);
  // As the ground to go on from.
  for (const std::string from : {"dig", "whole"}) {
    std::string text = half_sine_scenario("{level_set: " + from + "/" + file + "}", "dig.csv");
    text.replace(text.find("0.025"), 5, "0.05");
    write_file(folder() / ("on_" + from + ".yaml"), text);
    EXPECT_EQ(run("run on_" + from + ".yaml --out on_" + from).status, 0);
  }
  EXPECT_EQ(hash("on_dig/soil_final.vdb"), hash("on_whole/soil_final.vdb"));
}

TEST_F(Incremental, OnlyTheNewestAndWhatTheyNeedAreKept) {
  run_with("every: 1", "whole");
  for (const std::size_t keep : {2, 5}) {
    for (const char* kind : {"", ", incremental: true"}) {
      run_with(fmt::format("every: 1{}, keep: {}", kind, keep), "dig");
      const std::vector<io::JournalFile> files = snapshots("dig");
      std::set<std::string> expected = {"soil_final.vdb"}, needed;
      for (std::size_t i = files.size(); i-- > 0;) {
        if (files.size() - i > keep && !needed.contains(files[i].name)) continue;
        expected.insert(files[i].name);
        needed.insert(files[i].parent);
      }
      std::set<std::string> there;
      for (const auto& [name, bytes] : vdb_files("dig")) there.insert(name);
      EXPECT_EQ(there, expected);
      EXPECT_LT(there.size(), vdb_files("whole").size());
      EXPECT_GE(files.size(), keep);
      const nlohmann::json summary = read_json(folder() / "dig/summary.json");
      for (const auto& name : summary["files"])
        EXPECT_TRUE(fs::exists(folder() / "dig" / std::string(name))) << name;
      for (const std::string& name : there) EXPECT_EQ(hash("dig/" + name), hash("whole/" + name));
    }
  }
}

TEST_F(Incremental, KeysAreChecked) {
  const auto refused = [&](const std::string& snapshots, const std::string& hint) {
    write_file(folder() / "bad.yaml",
               half_sine_scenario("{plane: {z: 0}}", "dig.csv",
                                  fmt::format("{{snapshots: {{{}}}}}", snapshots)));
    expect_refused("run bad.yaml", hint);
  };
  refused("every: 1, keep: 1", "keep is 1; it must be a whole number from 2 to 1000000");
  refused("every: 1, keep: 2.5", "keep is 2.5; it must be a whole number");
  refused("every: 1, incremental: yes", "incremental is 'yes'; it must be true or false");
  refused("incremental: true", "key 'every' is missing");
}

TEST_F(Incremental, AWholeOneComesAfterALongChain) {
  // A long trench, then a dip into one place of it every second.
  std::string csv = "time,x,y,z\n0,0,0,-0.1\n40,40,0,-0.1\n";
  for (int i = 1; i <= 75; ++i) csv += fmt::format("{},40,0,{}\n", 40 + i, -0.1 - 0.002 * i);
  write_file(folder() / "dig.csv", csv);
  std::string text = half_sine_scenario("{plane: {z: 0}}", "dig.csv",
                                        "{snapshots: {every: 1, incremental: true}}");
  text.replace(text.find("0.025"), 5, "0.05");
  write_file(folder() / "dig.yaml", text);
  good("run dig.yaml --out o");
  std::size_t deepest = 0;
  for (const io::JournalFile& file : io::read_journal(folder() / "o/journal").files) {
    if (file.parent.empty()) continue;
    io::SnapshotInfo info;
    ASSERT_NO_THROW(io::read_snapshot(folder() / "o" / file.name, &info)) << file.name;
    deepest = std::max(deepest, info.parent->depth);
  }
  EXPECT_EQ(deepest, io::kMaxChainLength);
}

}  // namespace incremental_test
}  // namespace soilvdb::test
