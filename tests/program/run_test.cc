// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb run, from a scenario on disk to the files it leaves.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <regex>
#include <set>

#include "soilvdb/ground.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "tests/program/run_fixture.h"
#include "tools/run/snapshot_schedule.h"

namespace soilvdb::test {
namespace run_test {

std::vector<std::string> keys(const nlohmann::json& map) {
  std::vector<std::string> names;
  for (const auto& [key, value] : map.items()) names.push_back(key);
  return names;
}

TEST_F(Run, HalfSineVolumeIsExactHoweverTheMotionIsSplit) {
  for (const int updates : {50, 500}) {
    const auto s = summary(fmt::format("dig.yaml --updates {}", updates));
    EXPECT_EQ(s["updates"], updates);
    EXPECT_NEAR(s["volume_m3"]["cut"], HalfSine::kVolume_m3, 0.005 * HalfSine::kVolume_m3);
    EXPECT_LT(std::abs(s["volume_m3"]["residual"].get<double>()), 1e-9);
    EXPECT_EQ(s["machines"][0]["bucket_m3"], s["volume_m3"]["captured"]);
  }
}

TEST_F(Run, VolumeIsTheSameAtUtmCoordinatesAndAnyHeading) {
  HalfSine dig;
  dig.x_m = 500000, dig.y_m = 4200000, dig.yaw_rad = 33 * std::numbers::pi / 180;
  write_file(folder() / "dig.csv", dig.csv(kRows));
  const auto s = summary("dig.yaml --updates 500");
  EXPECT_NEAR(s["volume_m3"]["cut"], HalfSine::kVolume_m3, 0.002 * HalfSine::kVolume_m3);
}

TEST_F(Run, SummaryHasTheDocumentedKeys) {
  const auto s = summary("dig.yaml --threads 1");
  using Keys = std::vector<std::string>;  // nlohmann::json sorts them
  EXPECT_EQ(keys(s), (Keys{"acknowledged", "files", "machines", "memory_bytes", "scenario", "soil",
                           "soilvdb", "state_hash", "threads", "update_us", "updates", "volume_m3",
                           "voxel_size_m", "wall_s"}));
  EXPECT_EQ(keys(s["acknowledged"]), (Keys{"time_s", "updates"}));
  EXPECT_EQ(keys(s["volume_m3"]), (Keys{"captured", "cut", "displaced", "dumped", "ground_change",
                                        "net_cut", "net_fill", "residual"}));
  EXPECT_EQ(keys(s["machines"][0]), (Keys{"bad_rows", "bucket_m3", "cut_m3", "name"}));
  EXPECT_EQ(keys(s["update_us"]), (Keys{"max", "mean", "p50", "p99"}));
  EXPECT_EQ(keys(s["wall_s"]), (Keys{"open", "total", "updates"}));
  EXPECT_EQ(keys(s["memory_bytes"]), (Keys{"peak_rss", "soil"}));
  EXPECT_EQ(keys(s["soil"]), (Keys{"active_voxels", "leaves", "resident_m2"}));
  EXPECT_EQ(s["soilvdb"], 1);
  EXPECT_EQ(s["scenario"], "dig");
  EXPECT_EQ(s["voxel_size_m"], 0.025);
  EXPECT_EQ(s["threads"], 1);
  EXPECT_EQ(s["state_hash"].get<std::string>().size(), 16u);
  EXPECT_LE(s["update_us"]["p50"], s["update_us"]["p99"]);
  EXPECT_LE(s["update_us"]["p99"], s["update_us"]["max"]);
  EXPECT_GT(s["soil"]["leaves"], 0);
}

TEST_F(Run, UpdatesCsvHasARowPerRowOfTheMotionAndSumsToTheCut) {
  const auto s = summary("dig.yaml");
  EXPECT_EQ(s["updates"], kRows);
  std::istringstream csv(read_file(folder() / "out/dig/updates.csv"));
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(line, "time,machine,cut_m3,bucket_m3,update_us");
  int rows = 0;
  double cut_m3 = 0, bucket_m3 = 0, time_s = -1;
  for (; std::getline(csv, line); ++rows) {
    std::istringstream fields(line);
    std::vector<std::string> f;
    for (std::string field; std::getline(fields, field, ',');) f.push_back(field);
    ASSERT_EQ(f.size(), 5u) << line;
    EXPECT_GT(std::stod(f[0]), time_s);
    time_s = std::stod(f[0]);
    EXPECT_EQ(f[1], "digger");
    cut_m3 += std::stod(f[2]);
    bucket_m3 = std::stod(f[3]);
  }
  EXPECT_EQ(rows, kRows);
  EXPECT_EQ(time_s, 5);
  EXPECT_NEAR(cut_m3, s["volume_m3"]["cut"], 1e-12);
  EXPECT_NEAR(bucket_m3, s["machines"][0]["bucket_m3"], 1e-12);
}

TEST_F(Run, SameBitsWithAnyNumberOfThreads) {
  std::set<std::string> hashes;
  for (const int threads : {1, 2, 3})
    hashes.insert(summary(fmt::format("dig.yaml --threads {}", threads))["state_hash"]);
  EXPECT_EQ(hashes.size(), 1u);
}

TEST_F(Run, SnapshotsOnTheWayDoNotChangeTheGround) {
  write_file(folder() / "often.yaml",
             half_sine_scenario("{plane: {z: 0}}", "dig.csv", "{snapshots: {every: 1}}"));
  const auto often = summary("often.yaml --out often", "often");
  const auto never = summary("often.yaml --no-snapshots --out never", "never");
  EXPECT_EQ(often["state_hash"], never["state_hash"]);
  EXPECT_EQ(often["files"],
            nlohmann::json({"soil_1.vdb", "soil_2.vdb", "soil_3.vdb", "soil_4.vdb", "soil_5.vdb",
                            "updates.csv", "soil_final.vdb", "journal", "summary.json"}));
  EXPECT_EQ(never["files"], nlohmann::json({"updates.csv", "journal", "summary.json"}));
  for (const auto& [out, s] : {std::pair("often", often), std::pair("never", never)}) {
    std::set<std::string> there;
    for (const auto& entry : fs::directory_iterator(folder() / out))
      there.insert(entry.path().filename());
    EXPECT_EQ(there, s["files"].get<std::set<std::string>>());
  }
  io::SnapshotInfo info;
  io::read_snapshot(folder() / "often/soil_2.vdb", &info);
  EXPECT_EQ(info.time_s, 2);
}

TEST_F(Run, GoesOnFromASnapshotWithTheSameBits) {
  const auto whole = summary("dig.yaml");
  constexpr int kHalf = kRows / 2;
  write_file(folder() / "first.csv", HalfSine{}.csv(kRows, 0, kHalf));
  write_file(folder() / "second.csv", HalfSine{}.csv(kRows, kHalf, kRows - 1));
  write_file(folder() / "first.yaml", half_sine_scenario("{plane: {z: 0}}", "first.csv"));
  write_file(folder() / "second.yaml",
             half_sine_scenario("{level_set: first/soil_final.vdb}", "second.csv"));
  const auto first = summary("first.yaml --out first", "first");
  const auto second = summary("second.yaml --out second", "second");
  EXPECT_LT(first["volume_m3"]["cut"], whole["volume_m3"]["cut"]);
  EXPECT_DOUBLE_EQ(
      first["volume_m3"]["cut"].get<double>() + second["volume_m3"]["cut"].get<double>(),
      whole["volume_m3"]["cut"]);
  EXPECT_LT(std::abs(second["volume_m3"]["residual"].get<double>()), 1e-9);
  EXPECT_FALSE(second["volume_m3"].contains("net_cut")) << "against what would it be?";
  const Result diff = run("diff second/soil_final.vdb out/dig/soil_final.vdb --json");
  ASSERT_EQ(diff.status, 0) << diff.err;
  const auto change = nlohmann::json::parse(diff.out);
  EXPECT_EQ(change["cut_m3"], 0);
  EXPECT_EQ(change["fill_m3"], 0);
  // And the ground that was loaded is the ground that was saved.
  write_file(folder() / "second.csv", "time,x,y,z\n0,0,0,9\n");
  EXPECT_EQ(summary("second.yaml --out third", "third")["state_hash"], first["state_hash"]);
}

TEST_F(Run, VoxelOptionReplacesTheScenariosSize) {
  const auto s = summary("--voxel 0.05 dig.yaml --updates 50");
  EXPECT_EQ(s["voxel_size_m"], 0.05);
  EXPECT_NEAR(s["volume_m3"]["cut"], HalfSine::kVolume_m3, 0.02 * HalfSine::kVolume_m3);
}

TEST_F(Run, AMotionOfOneRowIsOneUpdate) {
  write_file(folder() / "dig.csv", "time,x,y,z\n0,0,0,-0.1\n");
  for (const char* updates : {"", "--updates 7"}) {
    const Result result = run(std::string("run dig.yaml ") + updates);
    EXPECT_EQ(result.status, 0);
    EXPECT_EQ(result.err, "soilvdb: warning: no bucket met any soil\n");
    const auto s = read_json(folder() / "out/dig/summary.json");
    EXPECT_EQ(s["updates"], 1);
    EXPECT_EQ(s["volume_m3"]["cut"], 0);
  }
}

TEST_F(Run, SizesAreSaidInAsFewDigitsAsTheyNeed) {
  std::string text = half_sine_scenario();
  text.replace(text.find("height: 0.5"), 11, "height: 1.04");
  text.replace(text.find("width: 0.2"), 10, "width: 1.04");  // a fifth: 0.20800000000000002
  write_file(folder() / "large.yaml", text);
  expect_refused("run large.yaml --voxel 3",
                 "voxels of 3 m are larger than the bucket of digger, "
                 "1.04 m x 1.04 m, and would show nothing of what it "
                 "digs; the voxel size must be 0.208 m or less");
}

TEST_F(Run, VoxelsThatAreTooLargeForABucketAreWarnedOf) {
  EXPECT_EQ(run("run dig.yaml --updates 20 --voxel 0.1").err, "");
  const Result result = run("run dig.yaml --updates 20 --voxel 0.11");
  EXPECT_EQ(result.status, 0);
  EXPECT_TRUE(
      result.err.starts_with("soilvdb: warning: dig.yaml: voxels of 0.11 m are too large "
                             "for the bucket of digger, 0.2 m x 0.5 m"))
      << result.err;
  expect_refused("run dig.yaml --voxel 1.1 --out none",
                 "dig.yaml: voxels of 1.1 m are larger than the bucket of digger, 0.2 m x 0.5 m");
}

TEST_F(Run, VoxelsThatAreTooLargeForABucketAreWarnedOfBeforeARun) {
  const std::string text = half_sine_scenario();
  EXPECT_EQ(run("info dig.yaml").out.find("too large"), std::string::npos);
  write_file(folder() / "large.yaml",
             std::regex_replace(text, std::regex("voxel_size: [0-9.]+"), "voxel_size: 0.11"));
  EXPECT_NE(run("info large.yaml")
                .out.find("large.yaml: voxels of 0.11 m are too large for the "
                          "bucket of digger"),
            std::string::npos);
}

// Of one machine and of several, which move in batches, at any number of updates.
TEST_F(Run, ABucketThatIsDraggedBackwardsIsWarnedOfOnce) {
  constexpr const char* kMachine =
      "  - {{name: {}, bucket: {{width: 1.2, height: 0.9, profile: [[0, 0], [-0.45, -0.1], [-0.85, "
      "0.15], [-0.95, 0.55], [-0.7, 0.9], [0, 0.9]]}}, motion: {}.csv}}\n";
  /// At 1 m/s, first ahead, where it loads, and then back.
  const auto motion = [&](const char* name, double y, double turns_s) {
    std::string csv = "time,x,y,z\n";
    for (double t = 0; t < 10.05; t += 0.1)
      csv += fmt::format("{:.1f},{:.1f},{},-0.2\n", t, std::min(t, 2 * turns_s - t), y);
    write_file(folder() / fmt::format("{}.csv", name), csv);
    return fmt::format(fmt::runtime(kMachine), name, name);
  };
  const std::string on = motion("on", 3, 11), back = motion("back", 0, 0);
  for (const std::string& soil : {std::string(), std::string("soil: {repose_angle: 0.6}\n")}) {
    for (const std::string& machines : {back, back + on, on}) {
      write_file(folder() / "drag.yaml", "soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: 0}}\n" +
                                             soil + "machines:\n" + machines);
      for (const double turns_s : {0.0, 2.0}) {
        motion("back", 0, turns_s);
        for (const char* updates : {"", " --updates 20"}) {
          SCOPED_TRACE(fmt::format("{}{}{} {}", soil, machines, updates, turns_s));
          const std::string told = run(std::string("run drag.yaml") + updates).err;
          std::smatch line;
          std::regex_search(told, line,
                            std::regex("warning: drag.yaml: at ([0-9.]+) s machine 'back' moved "
                                       "backwards through soil for 2 m and caught none: the x axis "
                                       "of its bucket must point out of the mouth"));
          if (machines == on) {
            EXPECT_EQ(told.find("backwards"), told.npos) << told;
            continue;
          }
          ASSERT_FALSE(line.empty()) << told;
          // Its back comes to soil where it began, or to what it spilled on its way; an update
          // takes up to 0.5 s.
          if (soil.empty() || turns_s == 0)
            EXPECT_NEAR(std::stod(line[1]), 2 * turns_s + 2.25, 0.5);
          else
            EXPECT_GE(std::stod(line[1]), turns_s + 2);
          EXPECT_EQ(told.find("backwards"), told.rfind("backwards")) << told;
        }
      }
    }
  }
}

/// A bucket that shuttles along a trench, in more rows than are in memory at once.
TEST_F(Run, AMotionOfAnyLengthDigsTheSameHoweverItIsSplit) {
  constexpr int kLong = 40'001;
  constexpr double kTrench_m3 = 2.0 * 0.2 * 0.25;  // length x width x depth
  std::string csv = "time,x,y,z\n";
  for (int i = 0; i < kLong; ++i)
    csv +=
        fmt::format("{:.2f},{:.6f},0,-0.25\n", i * 0.01, -std::cos(std::numbers::pi * i / 10'000));
  write_file(folder() / "dig.csv", csv);
  const auto count = [&] {
    const std::string rows = read_file(folder() / "out/dig/updates.csv");
    return std::count(rows.begin(), rows.end(), '\n') - 1;
  };
  const double by_rows_m3 = summary("dig.yaml")["volume_m3"]["cut"];
  EXPECT_EQ(count(), kLong);
  EXPECT_NEAR(by_rows_m3, kTrench_m3, 0.002 * kTrench_m3);
  for (const char* updates : {"1", "7", "1e3"}) {
    const auto s = summary(fmt::format("dig.yaml --updates {}", updates));
    EXPECT_EQ(s["updates"], std::stod(updates));
    EXPECT_EQ(count(), std::stod(updates));
    EXPECT_NEAR(s["volume_m3"]["cut"], by_rows_m3, 1e-4 * by_rows_m3);
  }
}

TEST_F(Run, SaysThatTimesOfUpdatesMayAddUpToMoreThanTheWhole) {
  std::string text = half_sine_scenario();
  text += "  - name: second\n    bucket: {width: 0.2, height: 0.5}\n    motion: dig.csv\n";
  write_file(folder() / "two.yaml", text);
  EXPECT_NE(run("run two.yaml --threads 2").out.find(", one by one: several may run at once"),
            std::string::npos);
  EXPECT_EQ(run("run dig.yaml --threads 2").out.find("one by one"), std::string::npos);
}

TEST_F(Run, MachinesMoveInTheOrderOfTime) {
  HalfSine beside;
  beside.y_m = 3, beside.duration_s = 2.5;
  write_file(folder() / "beside.csv", beside.csv(11));
  write_file(folder() / "dig.csv", HalfSine{}.csv(11));
  write_file(
      folder() / "two.yaml",
      half_sine_scenario() +
          "  - name: \"a, b\"\n    bucket: {width: 0.2, height: 0.5}\n    motion: beside.csv\n");
  const auto s = summary("two.yaml --updates 4");
  EXPECT_EQ(s["updates"], 8);
  ASSERT_EQ(s["machines"].size(), 2u);
  EXPECT_NEAR(s["machines"][0]["cut_m3"], s["machines"][1]["cut_m3"], 0.005 * HalfSine::kVolume_m3);
  std::istringstream csv(read_file(folder() / "out/dig/updates.csv"));
  std::string line;
  std::getline(csv, line);
  for (const char* begin : {"0.625,\"a, b\",", "1.25,digger,", "1.25,\"a, b\",", "1.875,\"a, b\",",
                            "2.5,digger,", "2.5,\"a, b\",", "3.75,digger,", "5,digger,"}) {
    std::getline(csv, line);
    EXPECT_TRUE(line.starts_with(begin)) << line << " instead of " << begin;
  }
}

TEST_F(Run, ASnapshotHoldsWhatEveryMachineHadDone) {
  HalfSine beside;
  beside.y_m = 3;
  const std::string scenario =
      half_sine_scenario() +
      "  - {name: other, bucket: {width: 0.2, height: 0.5}, motion: beside.csv}\n"
      "output: {snapshots: {every: 1}}\n";
  const auto dig = [&](const std::string& out, int last_row) {
    write_file(folder() / "dig.csv", HalfSine{}.csv(11, 0, last_row));
    write_file(folder() / "beside.csv", beside.csv(11, 0, last_row));
    write_file(folder() / (out + ".yaml"), scenario);
    summary(out + ".yaml --out " + out, out);
  };
  dig("whole", 10);
  dig("part", 2);
  const Result diff = run("diff whole/soil_1.vdb part/soil_final.vdb --json");
  ASSERT_EQ(diff.status, 0) << diff.err;
  const auto change = nlohmann::json::parse(diff.out);
  EXPECT_EQ(change["cut_m3"], 0);
  EXPECT_EQ(change["fill_m3"], 0);
}

TEST_F(Run, AsksForMeshAndRasterAreMet) {
  write_file(folder() / "dig.yaml",
             half_sine_scenario("{plane: {z: 0}}", "dig.csv", "{mesh: obj, raster: {cell: 0.05}}"));
  summary("dig.yaml");
  EXPECT_GT(fs::file_size(folder() / "out/dig/soil_final.obj"), 1000u);
  const auto raster = io::open_raster(folder() / "out/dig/soil_final.tif");
  EXPECT_DOUBLE_EQ(raster.grid.spacing.x(), 0.05);
  const auto s = summary("dig.yaml --no-mesh --out plain", "plain");
  EXPECT_FALSE(fs::exists(folder() / "plain/soil_final.obj"));
}

TEST(SnapshotSchedule, SnapshotsAreDueAtMultiplesHoweverTheyAreRounded) {
  for (const double begin_s : {0.0, 1000.0}) {
    tools::SnapshotSchedule schedule(0.1, begin_s, begin_s + 100);
    for (int i = 1; i <= 1000; ++i) EXPECT_TRUE(schedule.due(begin_s + 0.1 * i)) << i;
  }
}

}  // namespace run_test
}  // namespace soilvdb::test
