// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs whose soil moves come out the same, however many threads they have and however they are
// paged, looked at and interrupted, and hardly depend on how many updates there are. crash_test.cc
// kills them.
#include <algorithm>
#include <random>

#include "io/snapshot/swap_file.h"
#include "tests/program/moving_soil.h"
#include "tests/support/earthmoving_fixture.h"
#include "tests/support/faults.h"

namespace soilvdb::test {
namespace moving_soil_laws_test {

using nlohmann::json;

class MovingSoilLaws : public MovingSoil {};

TEST_F(MovingSoilLaws, ThreadsMakeNoDifference) {
  summary("all.yaml --threads 1", "one");
  for (const char* threads : {"2", "4"}) {
    summary(fmt::format("all.yaml --threads {}", threads), "more" + std::string(threads));
    EXPECT_TRUE(essence("more" + std::string(threads)) == essence("one")) << threads;
  }
}

TEST_F(MovingSoilLaws, WhoeverLooksMakesNoDifference) {
  const std::string all = std::string(kSoil) + kDigger + kPours + kHopper;
  const json s = summary("all.yaml --no-snapshots", "blind");
  summary("all.yaml", "out");
  write("look.yaml", all, "{plane: {z: 0}}",
        "{snapshots: {every: 0.1, incremental: true, keep: 2}, mesh: glb, raster: {cell: 0.1}}");
  summary("look.yaml", "look");
  EXPECT_TRUE(state("look") == state("out"));
  const json blind = read_json(folder() / "blind/summary.json"),
             seen = read_json(folder() / "look/summary.json");
  for (const char* key : {"state_hash", "volume_m3", "mass_kg", "machines", "updates"})
    EXPECT_EQ(blind[key], seen[key]) << key;
}

TEST(MovingSoilPaged, PagingMakesNoDifference) {
  const test::TempFolder folder;
  Work free(terrains()[1], 5), paged(terrains()[1], 5);
  constexpr int kSteps = 160;
  for (int i = 0; i < kSteps; ++i) free.step();
  paged.ground.set_memory_limit(free.ground.memory_bytes() * 3 / 4,
                                std::make_shared<io::SwapFile>(folder.path()));
  bool swapped = false;
  for (int i = 0; i < kSteps; ++i) {
    paged.step();
    const auto chunks = paged.ground.chunks();
    swapped |= std::any_of(chunks.begin(), chunks.end(), [](const Chunk* chunk) {
      return chunk->swap_record != 0 && chunk->loose_count > 0;
    });
    ASSERT_EQ(residual(paged.tracker), 0);
  }
  EXPECT_TRUE(swapped) << "no loose soil was ever paged out";
  EXPECT_EQ(paged.ground.state_hash(), free.ground.state_hash());
  EXPECT_EQ(paged.tracker.state(), free.tracker.state());
}

/// The most that updates say a bucket held.
double most_load_m3(const std::vector<std::vector<std::string>>& rows) {
  double most = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) most = std::max(most, std::stod(rows[i].at(3)));
  return most;
}

TEST_F(MovingSoilLaws, UpdatesOfABucketThatNeverTurnsMakeNoDifference) {
  write_file(folder() / "dig.csv", dig_csv(/*curls=*/false));
  const json s = summary("all.yaml", "rows");
  for (const char* key : {"spilled", "slid", "displaced"}) EXPECT_GT(s["volume_m3"][key], 0.05);
  for (const int updates : {20, 100, test::kLong ? 5000 : 1000}) {
    const std::string out = fmt::format("u{}", updates);
    EXPECT_EQ(summary(fmt::format("all.yaml --updates {}", updates), out)["mass_kg"]["residual"],
              0);
    EXPECT_TRUE(state(out) == state("rows")) << updates;
  }
}

/// Where it turns, the paths between poses differ by up to a fiftieth of a voxel, and cuts by 1e-4.
/// What is too much for it at the end of an update leaves it then, also in the ground.
TEST_F(MovingSoilLaws, UpdatesOfABucketThatCurlsMakeHardlyADifference) {
  const json many = summary("all.yaml --updates 5000", "many");
  const double load = most_load_m3(rows("many"));
  EXPECT_GT(load, 0.2);
  for (const int updates : {20, 30, 100}) {
    const std::string out = fmt::format("u{}", updates);
    const json few = summary(fmt::format("all.yaml --updates {}", updates), out);
    EXPECT_EQ(few["mass_kg"]["residual"], 0);
    EXPECT_NEAR(most_load_m3(rows(out)), load, 0.01 * load) << updates;
    const json diff = json::parse(
        good(fmt::format("diff many/soil_final.vdb {}/soil_final.vdb --json", out)).out);
    EXPECT_LE(
        diff["cut_m3"].get<double>() + diff["fill_m3"].get<double>(),
        0.02 * (many["volume_m3"]["cut"].get<double>() + many["volume_m3"]["fill"].get<double>()))
        << updates;
  }
}

TEST_F(MovingSoilLaws, GoesOnToTheSameBitsFromAnywhere) {
  const std::vector<const char*> all_options = {" --updates 30", "", " --updates 700"};
  for (std::size_t i = 0; i < (test::kLong ? all_options.size() : 1); ++i) {
    const char* const options = all_options[i];
    fs::remove_all(folder() / "out");
    summary(std::string("all.yaml") + options, "out");
    const std::string whole = essence("out");
    for (const double share : {0.1, 0.35, 0.5, 0.8, 0.97}) {
      const bool snapshots = share > 0.4 || i == 1;
      SCOPED_TRACE(fmt::format("{} {} {}", options, share, snapshots));
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

TEST_F(MovingSoilLaws, WhatIsGoneOfAFinishedRunIsMadeAgain) {
  summary("all.yaml", "out");
  const std::string whole = essence("out");
  for (const char* name : {"soil_final.vdb", "updates.csv", "summary.json", "soil_4.vdb"}) {
    fs::remove(folder() / "out" / name);
    good("resume out");
    EXPECT_TRUE(essence("out") == whole) << name;
  }
}

/// A machine at work at random over pours and a hopper, killed and gone on with again and again. In
/// its long form a million rows; `tools/bench faults` runs it.
TEST_F(MovingSoilLaws, MassClosesOverRandomWorkThroughKillsAndResumes) {
  const auto rows = static_cast<int>(faults(400, 1500, 1'000'000));
  const auto kills = static_cast<int>(faults(3, 6, 20));
  std::mt19937_64 random(1);
  const auto draw = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  std::string motion = "time,x,y,z,pitch,yaw\n";
  double x = 0, y = 0, z = 1, pitch = 0, yaw = 0;
  for (int i = 0; i < rows; ++i) {
    motion +=
        fmt::format("{:.1f},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f}\n", 0.1 * i, x, y, z, pitch, yaw);
    x = std::clamp(x + draw(-0.2, 0.2), -4.0, 4.0);
    y = std::clamp(y + draw(-0.2, 0.2), -4.0, 4.0);
    z = std::clamp(z + draw(-0.2, 0.2), -0.8, 2.0);
    pitch = std::clamp(pitch + draw(-0.3, 0.3), -1.6, 1.6);
    yaw = std::clamp(yaw + draw(-0.2, 0.2), -3.0, 3.0);
  }
  write_file(folder() / "dig.csv", motion);
  std::string all = std::string(kSoil) + kDigger + "pours:\n";
  const int pours = std::min(rows / 20, 2000);
  for (int i = 0; i < pours; ++i)
    all += fmt::format(
        "  - {{name: p{0}, at: [{1:.3f}, {2:.3f}, 6], time: [{3}, {4}], volume: {5:.4f}}}\n", i,
        draw(-4, 4), draw(-4, 4), 2 * i, 2 * i + (i % 4 == 0 ? 3 : 0), draw(0.001, 0.1));
  write("random.yaml", all + "hoppers: [{name: bed, box: [-5, -2, -2, 2], top: 1.2}]\n",
        "{plane: {z: 0, slope: [0.1, 0.05]}}",
        fmt::format("{{snapshots: {{every: {}, incremental: true, keep: 3}}}}", rows * 0.1 / 50),
        0.2);
  // Killed at an operation on a file, counted by the shim: times would kill none on a busy machine.
  const auto launch = [&](const std::string& command, const std::string& out,
                          const std::string& fault) {
    return shell(fmt::format(
        "SHIM_FOLDER='{0}' SHIM_LOG='{0}.log' SHIM_FAULT='{1}' LD_PRELOAD='{2}' '{3}' {4}",
        (folder() / out).string(), fault, SOILVDB_IO_SHIM, SOILVDB_PROGRAM, command));
  };
  ASSERT_EQ(launch("run random.yaml --out whole", "whole", "").status, 0);
  const json whole = read_json(folder() / "whole/summary.json");
  EXPECT_EQ(whole["mass_kg"]["residual"], 0);
  EXPECT_EQ(whole["volume_m3"]["residual"], 0);
  for (const char* key : {"cut", "displaced", "spilled", "poured", "hauled", "slid", "fill"})
    EXPECT_GT(whole["volume_m3"][key], 0) << key;
  const std::string log = read_file(folder() / "whole.log");
  const auto operations = static_cast<double>(std::count(log.begin(), log.end(), '\n'));
  int killed = 0;
  for (bool done = false; !done;) {
    const bool begun = fs::exists(folder() / "killed/journal");
    const double at = 1 + operations * draw(0.2, 0.9) / kills;
    const Result result = launch(begun ? "resume killed" : "run random.yaml --out killed", "killed",
                                 killed < kills ? fmt::format("kill {:.0f}", at) : "");
    done = result.status == 0;
    killed += !done;
    ASSERT_LE(killed, kills) << result.err;
  }
  EXPECT_GT(killed, 0);
  EXPECT_TRUE(state("killed") == state("whole"));
  record_faults(fmt::format("kill -9 over {} rows of random earthmoving", rows),
                static_cast<std::size_t>(killed), "mass residual 0; same bits");
}

}  // namespace moving_soil_laws_test
}  // namespace soilvdb::test
