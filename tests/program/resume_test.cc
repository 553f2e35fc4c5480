// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb resume: what it goes on from, what it refuses, and what it says.
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <set>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/raster.h"
#include "tests/program/resume_fixture.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace resume_test {

TEST_F(Resume, GoesOnFromTheNewestSnapshotToTheSameFiles) {
  run_whole("dig.yaml --threads 1");  // a snapshot is safe before the next update
  const nlohmann::json files = summary()["files"];
  interrupt(0.7);
  const Result result = good("resume out/dig");
  EXPECT_EQ(result.err, "");
  EXPECT_NE(result.out.find("updates acknowledged, to 3."), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("going on from soil_3.vdb"), std::string::npos) << result.out;
  expect_same_as_whole();
  EXPECT_EQ(summary()["files"], files);
  EXPECT_EQ(summary()["acknowledged"]["updates"], 41);
  EXPECT_EQ(summary()["acknowledged"]["time_s"], 5.0);
}

TEST_F(Resume, FromAnyPlaceAndUnderAnyOptions) {
  for (const char* options : {"", "--no-snapshots", "--updates 7", "--updates 300 --threads 1"}) {
    SCOPED_TRACE(options);
    for (const double share : {0.2, 0.5, 0.97}) {
      if (!test::kLong && share == 0.5) continue;
      run_part(share, std::string("dig.yaml ") + options);
      expect_goes_on_to_the_same();
      fs::remove_all(out());
    }
  }
}

TEST_F(Resume, InTheMiddleOfAnUpdateThatTakesSeveralPartsOfALongMotion) {
  write_file(folder() / "dig.csv", HalfSine{}.csv(40'001));
  write_scenario("{plane: {z: 0}}", "0.001");
  for (const char* options : {"--updates 2", "--updates 3001"}) {
    for (const double share : {0.3, 0.6, 0.9}) {
      run_part(share, std::string("dig.yaml ") + options);
      expect_goes_on_to_the_same();
    }
  }
}

TEST_F(Resume, OfSeveralMachinesOnARasterInUtmCoordinates) {
  HalfSine first, second;
  first.x_m = 500010, first.y_m = 4200010, first.yaw_rad = 0.6;
  second.x_m = 500012, second.y_m = 4200010, second.duration_s = 3.3;
  write_file(folder() / "dig.csv", first.csv(41));
  write_file(folder() / "beside.csv", second.csv(33));
  const HeightGrid grid{41, 41, {500000, 4200000}, {0.5, 0.5}};
  io::write_geotiff(folder() / "flat.tif", grid, {{"z", std::vector<float>(41 * 41)}}, "");
  std::string text = half_sine_scenario("{raster: flat.tif}", "dig.csv");
  text +=
      "  - name: other\n    bucket: {width: 0.4, height: 0.5, profile: [[0, 0], [-0.3, 0.2], "
      "[0, 0.5]], dump_angle: 0.5}\n    motion: beside.csv\n"
      "output: {snapshots: {every: 0.7}, mesh: ply, journal: {sync: always}}\n";
  write_file(folder() / "dig.yaml", text);
  for (const double share : {0.3, 0.8}) {
    run_part(share);
    expect_goes_on_to_the_same();
  }
}

TEST_F(Resume, AfterASignal) {
  run_whole("dig.yaml --updates 1000");
  const Result stopped = shell(fmt::format(
      "timeout --preserve-status -s TERM 0.4 '{}' run dig.yaml --updates 1000", SOILVDB_PROGRAM));
  if (stopped.status == 0) GTEST_SKIP() << "came to its end first";
  EXPECT_EQ(stopped.status, 1);
  EXPECT_NE(stopped.err.find("`soilvdb resume out/dig` goes on"), std::string::npos) << stopped.err;
  expect_goes_on_to_the_same();
}

TEST_F(Resume, OfAFinishedRunSaysSo) {
  run_whole();
  const auto before = content();
  const Result result = run("resume out/dig");
  EXPECT_EQ(result.status, 0);
  EXPECT_EQ(result.out, "out/dig: the run is finished: 41 updates to 5 s\n");
  EXPECT_EQ(content(), before);
}

TEST_F(Resume, FallsBackToAnOlderSnapshotAndSaysSo) {
  run_part(0.7, "dig.yaml --threads 1");
  damage("soil_3.vdb", fs::file_size(out() / "soil_3.vdb") / 2);
  fs::remove(out() / "soil_2.vdb");
  const Result result = good("resume out/dig");
  EXPECT_NE(result.err.find("soil_3.vdb: is damaged"), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("soil_2.vdb: is missing; it is made anew"), std::string::npos);
  EXPECT_NE(result.out.find("going on from soil_1.vdb"), std::string::npos) << result.out;
  expect_same_as_whole();  // soil_2.vdb and soil_3.vdb are written again
}

TEST_F(Resume, MakesDamagedFilesOfAFinishedRunAnew) {
  run_whole();
  const auto whole = content();
  const auto expect_made_anew = [&](const std::vector<std::string>& names, const char* fault) {
    EXPECT_EQ(run("verify out/dig").status, 1);
    const Result result = good("resume out/dig");
    for (const std::string& name : names) {
      const std::string said =
          fmt::format("soilvdb: warning: out/dig/{}: {}; it is made anew\n", name, fault);
      EXPECT_NE(result.err.find(said), std::string::npos) << result.err;
    }
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), std::ssize(names))
        << result.err;
    EXPECT_TRUE(
        result.out.starts_with("out/dig: the run is finished: 41 updates to 5 s\ngoing on "))
        << result.out;
    expect_same_as_whole();
    auto now = content();
    for (const auto& [name, bytes] : whole) {
      if (name.ends_with("/journal") || name.ends_with("/summary.json")) continue;
      EXPECT_TRUE(now[name] == bytes) << name;
    }
    EXPECT_EQ(now.size(), whole.size());
    EXPECT_EQ(run("resume out/dig").out, "out/dig: the run is finished: 41 updates to 5 s\n");
  };
  const std::vector<std::string> names = summary()["files"];
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string& name = names[i];
    if (name == "journal") continue;
    SCOPED_TRACE(name);
    const std::string summary = read_file(out() / "summary.json");
    if (i % 2) {
      damage(name, read_file(out() / name).size() / 2);
    } else {
      fs::remove(out() / name);
    }
    expect_made_anew({name},
                     i % 2 ? "is damaged: its checksum is not the journal's" : "is missing");
    if (name != "summary.json") {
      EXPECT_EQ(read_file(out() / "summary.json"), summary);
    }
  }
  const std::vector<std::string> several = {"soil_2.vdb", "soil_4.vdb", "soil_final.vdb",
                                            "soil_final.ply"};
  for (const std::string& name : several) fs::remove(out() / name);
  expect_made_anew(several, "is missing");
  // Not from other inputs.
  fs::remove(out() / "soil_4.vdb");
  write_file(folder() / "dig.csv", HalfSine{}.csv(41) + "6,1,0,1,0\n");
  expect_refused("resume out/dig", "dig.csv:43: was not there when the run was finished");
  write_file(folder() / "dig.csv", HalfSine{}.csv(41));
  expect_made_anew({"soil_4.vdb"}, "is missing");
}

TEST_F(Resume, RunDoesNotReplaceARunThatCanBeGoneOnWith) {
  run_part(0.6);
  write_file(out() / ".soil_4.vdb.4711-3.tmp", "half");
  const std::string way_out =
      "; `soilvdb resume out/dig` goes on with it; to begin anew remove the folder or name "
      "another\n";
  expect_refused("run dig.yaml", "out/dig: holds a run that isn't finished, good to 3.");
  expect_refused("run dig.yaml", way_out);
  expect_goes_on_to_the_same();
  EXPECT_EQ(run("run dig.yaml").status, 0);
  expect_same_as_whole();
  std::string whole_journal = read_file(out() / "journal");
  damage("journal", 60);
  expect_refused("run dig.yaml", "damaged at its start; remove the folder or name another");
  write_file(out() / "journal", "dear diary\n");
  expect_refused("run dig.yaml", "journal: is not a journal");
  write_file(out() / "journal", whole_journal.replace(whole_journal.size() / 2, 1, "?"));
  expect_refused("run dig.yaml", "out/dig: holds a run whose journal is damaged; `soilvdb resume");
  // One that hasn't dug yet is no loss.
  fs::remove_all(out());
  fs::create_directories(out());
  io::begin_journal(out() / "journal", {"configuration"});
  EXPECT_EQ(run("run dig.yaml").status, 0);
  expect_same_as_whole();
}

TEST_F(Resume, RunReplacesAFinishedRunWithAllItsFiles) {
  run_whole();
  write_file(out() / "notes.txt", "mine");
  write_file(out() / "soil_map.png", "mine");
  for (const char* options : {"--voxel 0.1", "--no-mesh", "--no-snapshots", ""}) {
    SCOPED_TRACE(options);
    EXPECT_EQ(run(std::string("run dig.yaml ") + options).status, 0);
    std::set<std::string> expected = summary()["files"], there;
    expected.insert({"notes.txt", "soil_map.png"});
    for (const auto& entry : fs::directory_iterator(out())) there.insert(entry.path().filename());
    EXPECT_EQ(there, expected);
  }
  expect_same_as_whole();
}

TEST_F(Resume, DigsAgainWhatADamagedJournalHeld) {
  run_part(0.9);
  const std::size_t at = fs::file_size(out() / "journal") / 3;
  damage("journal", at);
  const std::string damaged = read_file(out() / "journal");
  bad("verify out/dig", "journal is damaged at byte");
  const Result result = good("resume out/dig");
  EXPECT_NE(result.err.find("journal: is damaged at byte"), std::string::npos) << result.err;
  EXPECT_EQ(read_file(out() / "journal.damaged"), damaged);
  expect_same_as_whole();
}

TEST_F(Resume, RefusesWhatIsNoRun) {
  fs::create_directories(folder() / "empty");
  write_file(folder() / "other/journal", "dear diary\n");
  expect_refused("resume none", "none: is not a folder");
  expect_refused("resume dig.yaml", "dig.yaml: is not a folder");
  expect_refused("resume empty", "empty: holds no run");
  expect_refused("resume other", "journal: is not a journal");
  expect_refused("resume", "DIR");
}

TEST_F(Resume, KeepsOutOfAFolderWhereARunIsAtWork) {
  run_part(0.6);
  const int descriptor = open(out().c_str(), O_RDONLY | O_DIRECTORY);
  ASSERT_EQ(flock(descriptor, LOCK_EX | LOCK_NB), 0);
  expect_refused("resume out/dig", "another run or recording is at work");
  expect_refused("run dig.yaml", "another run or recording is at work");
  close(descriptor);
  EXPECT_EQ(run("resume out/dig").status, 0);
}

TEST_F(Resume, ClearsAwayWhatACrashLeftHalfDone) {
  run_part(0.6);
  write_file(out() / ".soil_4.vdb.4711-3.tmp", "half");
  write_file(out() / "updates.csv.part", "time");
  write_file(out() / ".mine.tmp", "mine");
  EXPECT_EQ(run("resume out/dig").status, 0);
  EXPECT_FALSE(fs::exists(out() / ".soil_4.vdb.4711-3.tmp"));
  EXPECT_FALSE(fs::exists(out() / "updates.csv.part"));
  EXPECT_TRUE(fs::exists(out() / ".mine.tmp"));
}

}  // namespace resume_test
}  // namespace soilvdb::test
