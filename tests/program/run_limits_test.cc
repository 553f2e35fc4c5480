// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb run where something runs short, stops it or looks on: memory, disks, signals, terminals.
#include <algorithm>
#include <cmath>

#include "soilvdb/ground.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "tests/program/run_fixture.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace run_limits_test {

TEST_F(Run, AnOutputRasterTooLargeIsRefusedBeforeTheRun) {
  write_file(folder() / "dig.yaml", half_sine_scenario() + "output: {raster: {cell: 0.1}}\n");
  // Two digs of a metre, 2 km apart either way; the bucket travels above the ground.
  write_file(folder() / "dig.csv",
             "time,x,y,z\n0,0,0,-0.2\n1,1,0,-0.2\n2,1,0,1\n500,2001,2000,1\n"
             "501,2001,2000,-0.2\n502,2002,2000,-0.2\n");
  expect_refused("run dig.yaml", "cells of 0.21 m would do");
  write_file(folder() / "dig.yaml", half_sine_scenario() + "output: {raster: {cell: 2}}\n");
  summary("dig.yaml");
  // Travel alone counts for nothing.
  write_file(folder() / "dig.yaml", half_sine_scenario() + "output: {raster: {cell: 0.1}}\n");
  write_file(folder() / "dig.csv",
             "time,x,y,z\n0,0,0,-0.2\n1,1,0,-0.2\n2,1,0,1\n500,2001,2000,1\n");
  summary("dig.yaml");
}

TEST_F(Run, OpensAKilometreQuicklyAndInLittleMemory) {
  constexpr int kPosts = 1001;
  HeightGrid grid{kPosts, kPosts, Vec2(500000, 4200000), Vec2(1, 1)};
  std::vector<float> heights;
  for (int y = 0; y < kPosts; ++y)
    for (int x = 0; x < kPosts; ++x)
      heights.push_back(static_cast<float>(100 + 5 * std::sin(x / 40.0) * std::cos(y / 60.0)));
  io::write_geotiff(folder() / "site.tif", grid, {{"height", heights}}, "");
  write_file(folder() / "site.yaml", half_sine_scenario("{raster: site.tif}"));
  write_file(folder() / "dig.csv", "time,x,y,z\n0,500500,4200500,120\n1,500501,4200500,120\n");
  double open_s = 1e9;  // the least of some: the computer may be busy
  for (int i = 0; i < 5 && open_s >= 1; ++i) {
    const Result result = run("run site.yaml --voxel 0.02");
    EXPECT_EQ(result.status, 0) << result.err;
    EXPECT_NE(result.err.find("no bucket met any soil"), std::string::npos);
    const auto s = read_json(folder() / "out/dig/summary.json");
    open_s = std::min(open_s, s["wall_s"]["open"].get<double>());
    EXPECT_LT(s["memory_bytes"]["peak_rss"], 200'000'000);
    EXPECT_EQ(s["soil"]["leaves"], 0);
  }
  EXPECT_LT(open_s, 1);
}

TEST_F(Run, LeavesOtherFilesAloneAndReplacesItsOwn) {
  write_file(folder() / "out/dig/notes.txt", "mine");
  summary("dig.yaml");
  const auto again = summary("dig.yaml --updates 3");
  EXPECT_EQ(again["updates"], 3);
  EXPECT_EQ(read_file(folder() / "out/dig/notes.txt"), "mine");
}

TEST_F(Run, LeavesFilesThatOnlyHaveTheNamesOfItsOwn) {
  write_file(folder() / "mine/soil_final.vdb", "mine");
  write_file(folder() / "mine/summary.json", "mine");
  write_file(folder() / "mine/soil_final.obj", "mine");  // which this run doesn't write
  expect_refused("run dig.yaml --out mine",
                 "mine: holds soil_final.vdb, summary.json, which is in no journal there and would "
                 "be overwritten; move it away or name another folder");
  fs::remove(folder() / "mine/summary.json");
  expect_refused("run dig.yaml --out mine", "mine: holds soil_final.vdb, which");
  EXPECT_EQ(run("run dig.yaml --out mine --no-snapshots").status, 0);
  EXPECT_EQ(read_file(folder() / "mine/soil_final.vdb"), "mine");
  EXPECT_EQ(read_file(folder() / "mine/soil_final.obj"), "mine");
}

TEST_F(Run, BeginsAnewOverASnapshotThatTheJournalDidNotLiveToKnow) {
  write_file(folder() / "dig.yaml", half_sine_scenario() + "output: {snapshots: {every: 1}}\n");
  const std::string hash = summary("dig.yaml")["state_hash"];
  const fs::path out = folder() / "out/dig";
  for (const char* name : {"summary.json", "soil_final.vdb", "updates.csv", "soil_2.vdb"})
    fs::remove(out / name);
  // Its first frame alone, which says what was asked for.
  std::uintmax_t size = fs::file_size(out / "journal");
  while (io::read_journal(out / "journal").done.updates > 0)
    fs::resize_file(out / "journal", size = size * 9 / 10);
  ASSERT_TRUE(fs::exists(out / "soil_1.vdb"));
  EXPECT_EQ(summary("dig.yaml")["state_hash"], hash);
}

TEST_F(Run, AFullDiskIsStatusOneAndSaysWhatIsSafe) {
  // A limit on the size of files stands for the full disk: writes fail in the same places.
  const Result result =
      shell(fmt::format("ulimit -f 8; '{}' run dig.yaml --out full", SOILVDB_PROGRAM));
  EXPECT_EQ(result.status, 1);
  EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
  EXPECT_FALSE(fs::exists(folder() / "full/summary.json"));
  const double reached_s = io::read_journal(folder() / "full/journal").done.time_s;
  EXPECT_TRUE(result.err.ends_with(
      fmt::format("; safe in full: journal; once that is mended `soilvdb resume full` goes on "
                  "from {} s\n",
                  reached_s)))
      << result.err;
  EXPECT_EQ(run("resume full").status, 0);
  EXPECT_EQ(read_json(folder() / "full/summary.json")["state_hash"],
            summary("dig.yaml")["state_hash"]);
}

TEST_F(Run, UpdatesThatTakeLongerThanASecondAreCountedToo) {
  // Half a minute's way in one.
  std::string csv = "time,x,y,z,yaw\n";
  for (int i = 0; i <= 3000; ++i)
    csv += fmt::format("{},{},{},-0.3,{}\n", i * 0.01, 4 * std::cos(i * 0.002),
                       4 * std::sin(i * 0.002), i * 0.002);
  write_file(folder() / "dig.csv", csv);
  const Result result = run("run dig.yaml --updates 1 --voxel 0.005 --threads 1 --no-snapshots");
  EXPECT_EQ(result.status, 0) << result.err;
  const double mean_us = read_json(folder() / "out/dig/summary.json")["update_us"]["mean"];
  const std::size_t rate = result.out.find("µs; ");
  ASSERT_NE(rate, std::string::npos) << result.out;
  constexpr double kTwoDigits = 0.05;
  EXPECT_NEAR(std::stod(result.out.substr(rate + 5)) * mean_us * 1e-6, 1, kTwoDigits) << result.out;
}

TEST_F(Run, ALimitOfMemoryChangesNothingAndAFullDiskCanBeGoneOnFrom) {
  if (test::kSanitized) GTEST_SKIP() << "minutes; memory_test and swap_file_test run the same code";
  const std::string fine = "dig.yaml --voxel 0.001 --updates 300 --no-mesh --no-snapshots";
  const auto free = summary(fine + " --out free", "free");
  const std::uint64_t limit = std::uint64_t{16} << 20;
  EXPECT_GT(free["memory_bytes"]["soil"], limit);
  EXPECT_EQ(summary(fine + " --memory 16 --out kept", "kept")["state_hash"], free["state_hash"]);
  expect_refused("run dig.yaml --memory 1", "from 16 to");
  // A limit on the size of files stands for the full disk.
  const std::string small = fmt::format("ulimit -f 400; '{}' ", SOILVDB_PROGRAM);
  const Result full = shell(small + "run " + fine + " --memory 16 --out full");
  EXPECT_EQ(full.status, 1);
  EXPECT_NE(full.err.find("cold ground"), std::string::npos) << full.err;
  EXPECT_NE(full.err.find("resume"), std::string::npos) << full.err;
  // Gone on with under the same limit: the disk is still full.
  const Result again = shell(small + "resume full");
  EXPECT_EQ(again.status, 1);
  EXPECT_NE(again.err.find("cold ground"), std::string::npos) << again.err;
  EXPECT_EQ(run("resume full --memory 1000").status, 0);
  EXPECT_EQ(read_json(folder() / "full/summary.json")["state_hash"], free["state_hash"]);
}

TEST_F(Run, ASignalStopsItWithWhatItHas) {
  // Sent twice at once, as some do, to a process and to its group.
  const Result result =
      shell(fmt::format("'{}' run dig.yaml --updates 100000000 --out stopped & sleep 1; "
                        "kill -TERM $!; kill -TERM $!; wait $!",
                        SOILVDB_PROGRAM));
  EXPECT_EQ(result.status, 1);
  EXPECT_NE(result.err.find("stopped by a signal"), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("soil_final.vdb"), std::string::npos) << result.err;
  const auto s = read_json(folder() / "stopped/summary.json");
  EXPECT_LT(s["updates"], 100000000);
  EXPECT_LT(std::abs(s["volume_m3"]["residual"].get<double>()), 1e-9);
  io::SnapshotInfo info;
  io::read_snapshot(folder() / "stopped/soil_final.vdb", &info);
  EXPECT_LT(info.time_s, 5);
}

TEST_F(Run, ShowsAProgressBarOnATerminalAndNothingWhenPiped) {
  if (std::system("script -qec true /dev/null >/dev/null 2>&1") != 0) GTEST_SKIP();
  const Result result = shell(fmt::format(
      "TERM=xterm script -qec \"'{}' run dig.yaml --voxel 0.01 --updates 100000\" /dev/null",
      SOILVDB_PROGRAM));
  EXPECT_EQ(result.status, 0);
  EXPECT_NE(result.out.find("#"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find(" left"), std::string::npos) << result.out;
  EXPECT_EQ(run("run dig.yaml --updates 20000").err, "");
}

TEST_F(Run, RefusesToWriteOverItsTerrain) {
  summary("dig.yaml");
  write_file(folder() / "next.yaml", half_sine_scenario("{level_set: out/dig/soil_final.vdb}"));
  expect_refused("run next.yaml", "soil_final.vdb: is an input");
  fs::create_symlink("out/dig/soil_final.vdb", folder() / "ground.vdb");
  write_file(folder() / "next.yaml", half_sine_scenario("{level_set: ground.vdb}"));
  expect_refused("run next.yaml", "ground.vdb: is an input");
}

}  // namespace run_limits_test
}  // namespace soilvdb::test
