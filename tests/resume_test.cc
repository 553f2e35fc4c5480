// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb resume and verify: what they go on from, what they refuse, and what they say.
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <set>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/raster.h"
#include "tests/program.h"

namespace soilvdb::testing {
namespace {

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
    const auto size = static_cast<double>(fs::file_size(out() / "journal"));
    fs::resize_file(out() / "journal", static_cast<std::uintmax_t>(size * share));
    for (const char* name : {"summary.json", "soil_final.vdb", "soil_final.ply", "updates.csv"})
      fs::remove(out() / name);
  }
  void expect_same_as_whole() const {
    EXPECT_EQ(summary()["state_hash"], hash_);
    EXPECT_EQ(summary()["volume_m3"]["cut"], cut_m3_);
    EXPECT_EQ(updates(), rows_);
    EXPECT_EQ(read_file(out() / "soil_final.ply"), mesh_);
    EXPECT_EQ(run("verify out/dig").status, 0);
  }

  fs::path out() const { return folder() / "out/dig"; }
  nlohmann::json summary() const { return read_json(out() / "summary.json"); }
  void expect_goes_on_to_the_same(double share) const {
    interrupt(share);
    const Result result = run("resume out/dig");
    EXPECT_EQ(result.status, 0) << result.err;
    expect_same_as_whole();
  }

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

TEST_F(Resume, GoesOnFromTheNewestSnapshotToTheSameFiles) {
  run_whole("dig.yaml --threads 1");  // a snapshot is safe before the next update
  const nlohmann::json files = summary()["files"];
  interrupt(0.7);
  const Result result = run("resume out/dig");
  EXPECT_EQ(result.status, 0) << result.err;
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
      run_whole(std::string("dig.yaml ") + options);
      expect_goes_on_to_the_same(share);
      fs::remove_all(out());
    }
  }
}

TEST_F(Resume, InTheMiddleOfAnUpdateThatTakesSeveralPartsOfALongMotion) {
  write_file(folder() / "dig.csv", HalfSine{}.csv(40'001));
  write_scenario("{plane: {z: 0}}", "0.001");
  for (const char* options : {"--updates 2", "--updates 3001"}) {
    for (const double share : {0.3, 0.6, 0.9}) {
      run_whole(std::string("dig.yaml ") + options);
      expect_goes_on_to_the_same(share);
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
    run_whole();
    expect_goes_on_to_the_same(share);
  }
}

TEST_F(Resume, AfterASignal) {
  run_whole("dig.yaml --updates 1000");
  const Result stopped = shell(fmt::format(
      "timeout --preserve-status -s TERM 0.4 '{}' run dig.yaml --updates 1000", SOILVDB_PROGRAM));
  if (stopped.status == 0) GTEST_SKIP() << "came to its end first";
  EXPECT_EQ(stopped.status, 1);
  EXPECT_NE(stopped.err.find("`soilvdb resume out/dig` goes on"), std::string::npos) << stopped.err;
  const Result result = run("resume out/dig");
  EXPECT_EQ(result.status, 0) << result.err;
  expect_same_as_whole();
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
  run_whole("dig.yaml --threads 1");
  interrupt(0.7);
  damage("soil_3.vdb", fs::file_size(out() / "soil_3.vdb") / 2);
  fs::remove(out() / "soil_2.vdb");
  const Result result = run("resume out/dig");
  EXPECT_EQ(result.status, 0) << result.err;
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
    const Result result = run("resume out/dig");
    EXPECT_EQ(result.status, 0) << result.err;
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
  run_whole();
  interrupt(0.6);
  write_file(out() / ".soil_4.vdb.4711-3.tmp", "half");
  const std::string way_out =
      "; `soilvdb resume out/dig` goes on with it; to begin anew remove the folder or give "
      "another --out\n";
  expect_refused("run dig.yaml", "out/dig: holds a run that isn't finished, good to 3 s");
  expect_refused("run dig.yaml", way_out);
  EXPECT_EQ(run("resume out/dig").status, 0);
  expect_same_as_whole();
  EXPECT_EQ(run("run dig.yaml").status, 0);
  expect_same_as_whole();
  std::string whole_journal = read_file(out() / "journal");
  damage("journal", 60);
  expect_refused("run dig.yaml", "damaged at its start; remove the folder or give another --out");
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
  run_whole();
  interrupt(0.9);
  const std::size_t at = fs::file_size(out() / "journal") / 3;
  damage("journal", at);
  const std::string damaged = read_file(out() / "journal");
  const Result verified = run("verify out/dig");
  EXPECT_EQ(verified.status, 1);
  EXPECT_NE(verified.err.find("journal is damaged at byte"), std::string::npos) << verified.err;
  const Result result = run("resume out/dig");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.err.find("journal: is damaged at byte"), std::string::npos) << result.err;
  EXPECT_EQ(read_file(out() / "journal.damaged"), damaged);
  expect_same_as_whole();
}

TEST_F(Resume, RefusesInputsThatHaveChangedOrGone) {
  const HeightGrid grid{9, 9, {-4, -4}, {1, 1}};
  io::write_geotiff(folder() / "flat.tif", grid, {{"z", std::vector<float>(81)}}, "");
  write_scenario("{raster: flat.tif}");
  run_whole();
  interrupt(0.6);
  for (const char* name : {"dig.yaml", "flat.tif"}) {
    const std::string text = read_file(folder() / name);
    std::string other = text + "\n";
    if (name == std::string("dig.yaml"))
      other.replace(other.find("height: 0.5"), 11, "height: 0.6");
    write_file(folder() / name, other);
    expect_refused("resume out/dig", std::string(name) + ": has changed since the run");
    const Result verified = run("verify out/dig");
    EXPECT_EQ(verified.status, 1);
    EXPECT_NE(verified.err.find(name), std::string::npos) << verified.err;
    fs::remove(folder() / name);
    expect_refused("resume out/dig", std::string(name) + ": is missing");
    write_file(folder() / name, text);
  }
  fs::rename(folder() / "dig.csv", folder() / "gone.csv");
  expect_refused("resume out/dig", "dig.csv: is missing");
  fs::rename(folder() / "gone.csv", folder() / "dig.csv");
  EXPECT_EQ(run("resume out/dig").status, 0);
  expect_same_as_whole();
}

TEST_F(Resume, ATerrainBesideWhatAFolderLinksToIsFoundAgain) {
  const HeightGrid grid{9, 9, {-4, -4}, {1, 1}};
  fs::create_directories(folder() / "data/a");
  io::write_geotiff(folder() / "data/flat.tif", grid, {{"z", std::vector<float>(81)}}, "");
  fs::create_directory_symlink(folder() / "data/a", folder() / "site");
  write_scenario("{raster: ../flat.tif}");
  for (const char* name : {"dig.yaml", "dig.csv"})
    fs::rename(folder() / name, folder() / "site" / name);
  const Result whole = run("run site/dig.yaml --out out");
  ASSERT_EQ(whole.status, 0) << whole.err;
  EXPECT_EQ(run("info out/soil_final.vdb").status, 0);
  fs::resize_file(folder() / "out/journal", fs::file_size(folder() / "out/journal") * 3 / 5);
  const Result result = run("resume out");
  EXPECT_EQ(result.status, 0) << result.err;
}

TEST_F(Resume, AnotherFileAtItsPlaceIsNotTakenForTheScenario) {
  run_whole();
  interrupt(0.6);
  write_file(folder() / "dig.yaml", "no: [scenario");
  expect_refused("resume out/dig", "dig.yaml: has changed since the run in out/dig began (");
}

TEST_F(Resume, AScenarioMayBeWrittenAnotherWayButMustSayTheSame) {
  run_whole();
  interrupt(0.6);
  const std::string text = read_file(folder() / "dig.yaml");
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string other = text;
    write_file(folder() / "dig.yaml", other.replace(other.find(from), from.size(), to));
  };
  for (const auto& [from, to, change] :
       {std::array{"0.05", "0.1", "(voxel_size was 0.05 and is 0.1)"},
        std::array{"width: 0.2", "width: 0.3", "(machines[0].bucket.width was 0.2 and is 0.3)"},
        std::array{"{every: 1}", "{}", "(output.snapshots.every was 1 and is gone)"},
        std::array{"mesh: ply", "mesh: ply, raster: {cell: 1}",
                   "(output.raster.cell was not there)"},
        std::array{"  - name: digger", "  - name: dagger", "name was digger and is dagger"}}) {
    SCOPED_TRACE(to);
    with(from, to);
    expect_refused("resume out/dig", "dig.yaml: has changed since the run in out/dig began");
    expect_refused("resume out/dig", change);
    EXPECT_EQ(run("verify out/dig").status, 1);
  }
  with("voxel_size: 0.05", "# as measured\nvoxel_size:   0.0500\n\n");
  EXPECT_EQ(run("verify out/dig").status, 0);
  with("name: dig\n", "name: 'dig'   # of last week\r\n");
  EXPECT_EQ(run("resume out/dig").status, 0);
  expect_same_as_whole();
}

TEST_F(Resume, FollowsALinkToItsTerrainAsItIsNow) {
  const HeightGrid grid{9, 9, {-4, -4}, {1, 1}};
  const fs::path project = folder() / "project", moved = folder() / "moved";
  fs::create_directories(project);
  fs::create_directories(folder() / "data");
  io::write_geotiff(folder() / "data/flat.tif", grid, {{"z", std::vector<float>(81)}}, "");
  fs::create_symlink(folder() / "data/flat.tif", project / "site.tif");
  write_scenario("{raster: site.tif}");
  for (const char* name : {"dig.yaml", "dig.csv"}) fs::rename(folder() / name, project / name);
  const Result whole = run("run project/dig.yaml --out project/out");
  ASSERT_EQ(whole.status, 0) << whole.err;
  const std::string hash = read_json(project / "out/summary.json")["state_hash"];
  fs::resize_file(project / "out/journal", fs::file_size(project / "out/journal") * 3 / 5);
  fs::rename(project, moved);
  fs::rename(folder() / "data", folder() / "data of May");
  const std::string there = (folder() / "project/site.tif").string(),
                    here = (moved / "site.tif").string();
  // A link that leads nowhere: both places are named, the one of then and the one looked at.
  const Result none = run("resume moved/out");
  EXPECT_EQ(none.status, 2);
  EXPECT_NE(none.err.find("soilvdb: " + there + ": is missing, and there is no moved/site.tif"),
            std::string::npos)
      << none.err;
  expect_refused("info moved/out/soil_2.vdb", "soil_2.vdb: its base surface " + there +
                                                  " is missing, and there is no " + here +
                                                  "; put it back there");
  fs::remove(moved / "site.tif");
  fs::create_symlink(folder() / "data of May/flat.tif", moved / "site.tif");
  EXPECT_EQ(run("info moved/out/soil_2.vdb").status, 0);
  const Result result = run("resume moved/out");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("going on from soil_"), std::string::npos) << result.out;
  EXPECT_EQ(result.err, "");
  EXPECT_EQ(read_json(moved / "out/summary.json")["state_hash"], hash);
}

TEST_F(Resume, FindsInputsThatMovedTogetherWithTheRun) {
  write_file(folder() / "site/dig.csv", HalfSine{}.csv(41));
  fs::copy(folder() / "dig.yaml", folder() / "site/dig.yaml");
  run_whole("site/dig.yaml");
  interrupt(0.6);
  fs::create_directories(folder() / "elsewhere/out");
  fs::rename(folder() / "site", folder() / "elsewhere/site");
  fs::rename(out(), folder() / "elsewhere/out/dig");
  EXPECT_EQ(run("resume elsewhere/out/dig").status, 0);
  EXPECT_EQ(read_json(folder() / "elsewhere/out/dig/summary.json")["state_hash"], hash_);
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
  run_whole();
  interrupt(0.6);
  const int descriptor = open(out().c_str(), O_RDONLY | O_DIRECTORY);
  ASSERT_EQ(flock(descriptor, LOCK_EX | LOCK_NB), 0);
  expect_refused("resume out/dig", "another run is at work");
  expect_refused("run dig.yaml", "another run is at work");
  close(descriptor);
  EXPECT_EQ(run("resume out/dig").status, 0);
}

TEST_F(Resume, ClearsAwayWhatACrashLeftHalfDone) {
  run_whole();
  interrupt(0.6);
  write_file(out() / ".soil_4.vdb.4711-3.tmp", "half");
  write_file(out() / "updates.csv.part", "time");
  write_file(out() / ".mine.tmp", "mine");
  EXPECT_EQ(run("resume out/dig").status, 0);
  EXPECT_FALSE(fs::exists(out() / ".soil_4.vdb.4711-3.tmp"));
  EXPECT_FALSE(fs::exists(out() / "updates.csv.part"));
  EXPECT_TRUE(fs::exists(out() / ".mine.tmp"));
}

TEST_F(Resume, VerifyNamesEveryFileThatIsNotAsItWasWritten) {
  run_whole();
  const Result good = run("verify out/dig");
  EXPECT_EQ(good.status, 0) << good.err;
  EXPECT_NE(good.out.find("out/dig: intact, good to 5 s"), std::string::npos) << good.out;
  for (const auto& entry : fs::directory_iterator(out())) {
    const std::string name = entry.path().filename();
    const std::string bytes = read_file(entry.path());
    EXPECT_EQ(run("verify out/dig/" + name).status, 0) << name;
    damage(name, bytes.size() / 2);
    for (const std::string& what : {std::string(), "/" + name}) {
      const Result bad = run("verify out/dig" + what);
      EXPECT_EQ(bad.status, 1) << name;
      EXPECT_NE(bad.err.find(name), std::string::npos) << bad.err;
      EXPECT_EQ(std::count(bad.err.begin(), bad.err.end(), '\n'), 1) << bad.err;
    }
    fs::remove(entry.path());
    if (name != "journal") {
      EXPECT_EQ(run("verify out/dig").status, 1) << name;
    }
    expect_refused("verify out/dig/" + name, name);
    write_file(entry.path(), bytes);
  }
}

TEST_F(Resume, VerifyFindsAFinishedRunWhoseJournalWasCutShortOrZeroed) {
  run_whole();
  const std::string journal = read_file(out() / "journal");
  const auto expect_found = [&](const std::string& bytes) {
    write_file(out() / "journal", bytes);
    const Result bad = run("verify out/dig");
    EXPECT_EQ(bad.status, 1);
    EXPECT_NE(bad.err.find("journal is damaged: it ends after"), std::string::npos) << bad.err;
    EXPECT_NE(bad.err.find("held 41 when summary.json was written"), std::string::npos) << bad.err;
    EXPECT_NE(bad.out.find("soil_4.vdb           is there, but the journal doesn't know it; by "
                           "itself good, the ground at 4 s"),
              std::string::npos)
        << bad.out;
    EXPECT_NE(bad.out.find("soil_1.vdb           good"), std::string::npos) << bad.out;
  };
  const std::size_t half = journal.size() / 2;
  expect_found(journal.substr(0, half));
  expect_found(journal.substr(0, half) + std::string(journal.size() - half, '\0'));
  EXPECT_EQ(run("resume out/dig").status, 0);
  expect_same_as_whole();
  write_file(out() / "journal", std::string(journal.size(), '\0'));
  const Result none = run("verify out/dig");
  EXPECT_EQ(none.status, 1);
  EXPECT_NE(none.out.find("soil_1.vdb           is there, but the journal doesn't know it; by "
                          "itself good, the ground at 1 s"),
            std::string::npos)
      << none.out;
}

TEST_F(Resume, VerifyNamesASnapshotThatTheJournalDoesNotKnow) {
  run_whole();
  fs::copy(out() / "soil_2.vdb", out() / "soil_2 of Monday.vdb");
  const Result result = run("verify out/dig");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("soil_2 of Monday.vdb is there, but the journal doesn't know it; by "
                            "itself good, the ground at 2 s\n"),
            std::string::npos)
      << result.out;
}

TEST_F(Resume, ByALinkToAFolderThatMovedWithItsInputs) {
  run_whole();
  interrupt(0.7);
  const fs::path moved = folder() / "moved/deep", link = folder() / "link";
  fs::create_directories(moved);
  for (const char* name : {"dig.yaml", "dig.csv", "out"}) fs::rename(folder() / name, moved / name);
  fs::create_directory_symlink(moved / "out/dig", link);
  const Result result = run("resume link");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(read_json(link / "summary.json")["state_hash"], hash_);
}

TEST_F(Resume, VerifyFindsAJournalThatIsDamagedAtItsStart) {
  run_whole();
  damage("journal", 60);
  for (const char* what : {"out/dig", "out/dig/journal"}) {
    const Result bad = run(fmt::format("verify {}", what));
    EXPECT_EQ(bad.status, 1);
    EXPECT_NE(bad.err.find("journal: is not a journal, or damaged at its start"),
              std::string::npos);
  }
}

TEST_F(Resume, VerifyOfAnInterruptedRunSaysHowFarItIsGood) {
  run_whole();
  interrupt(0.7);
  const Result result = run("verify out/dig");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("not finished"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("out/dig: intact, good to 3."), std::string::npos) << result.out;
  expect_refused("verify dig.yaml", "can't be verified");
  expect_refused("verify none", "none: no such file");
}

}  // namespace
}  // namespace soilvdb::testing
