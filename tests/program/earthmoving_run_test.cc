// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What runs of scenarios whose soil moves report, and what they warn of. moving_soil_laws_test.cc
// has that they come out the same.
#include <cmath>
#include <regex>

#include "soilvdb/io/raster.h"
#include "tests/program/moving_soil.h"

namespace soilvdb::test {
namespace earthmoving_run_test {

using nlohmann::json;

/// A run's motion up to before a time.
std::string dig_before(const std::string& time) {
  const std::string text = dig_csv();
  return text.substr(0, text.find('\n' + time + ',') + 1);
}

std::vector<std::string> keys(const json& object) {
  std::vector<std::string> all;
  for (const auto& item : object.items()) all.push_back(item.key());
  return all;  // sorted, as objects of this type are
}

TEST_F(MovingSoil, SaysWhereAllSoilWent) {
  const json s = summary("all.yaml", "out");
  const json &volume = s["volume_m3"], &mass = s["mass_kg"], &machine = s["machines"][0];
  EXPECT_EQ(keys(volume),
            (std::vector<std::string>{"captured", "cut", "displaced", "dumped", "fill",
                                      "ground_change", "hauled", "net_cut", "net_fill", "poured",
                                      "residual", "slid", "spilled"}));
  EXPECT_NEAR(volume["net_fill"].get<double>() - volume["net_cut"].get<double>(),
              volume["ground_change"], 1e-9);
  EXPECT_LT(volume["net_cut"], volume["cut"]) << "some was dug again";
  EXPECT_EQ(keys(mass), (std::vector<std::string>{"buckets", "ground_change", "hauled", "in_flight",
                                                  "poured", "residual"}));
  EXPECT_EQ(mass["residual"], 0);
  EXPECT_EQ(volume["residual"], 0);
  for (const char* key :
       {"cut", "captured", "displaced", "spilled", "poured", "hauled", "slid", "fill"})
    EXPECT_GT(volume[key], 0) << key;
  EXPECT_EQ(volume["dumped"], 0) << "no dump_angle";
  EXPECT_NEAR(volume["poured"], 0.5, 1e-6);
  EXPECT_NEAR(mass["poured"], 0.5 / 1.25 * 1800, 1e-3);
  EXPECT_NEAR(mass["hauled"].get<double>() / volume["hauled"].get<double>(), 1800 / 1.25, 1e-6);
  EXPECT_NEAR(mass["ground_change"].get<double>() + mass["buckets"].get<double>() +
                  mass["hauled"].get<double>() + mass["in_flight"].get<double>(),
              mass["poured"], 1e-6);
  EXPECT_LT(std::abs(mass["in_flight"].get<double>()), 1800 * std::pow(0.1, 3) / 64)
      << "less than a sample is left over";
  EXPECT_GT(machine["capacity_m3"]["heaped"], machine["capacity_m3"]["struck"]);
  EXPECT_EQ(machine["bucket_kg"], mass["buckets"]);
  // What was dug and fell back takes more room than it did, and what came was loose already.
  EXPECT_GT(volume["ground_change"], mass["ground_change"].get<double>() / 1800 * 1.25);
}

TEST_F(MovingSoil, TheTerminalHasTheTermsOfTheBalance) {
  const std::string out = good("run all.yaml --out told").out;
  std::smatch kg;
  ASSERT_TRUE(std::regex_search(
      out, kg,
      std::regex("\nbalance     0 m³, 0 kg: ground (-[0-9.]+) kg, hauled ([0-9.]+) kg,"
                 "( in flight -?[0-9.]+ kg,)? poured ([0-9.]+) kg\n")))
      << out;
  EXPECT_NEAR(std::stod(kg[1]) + std::stod(kg[2]), std::stod(kg[4]), 1) << "buckets are empty";
}

TEST_F(MovingSoil, WhatADumpAngleEmptiesIsDumped) {
  std::string digger = kDigger;
  write("dump.yaml", kSoil + digger + "      dump_angle: 0.5\n");
  const json s = summary("dump.yaml", "out"), &volume = s["volume_m3"];
  const auto all = rows("out");
  std::size_t at = 1;
  while (std::stod(all.at(at).at(0)) < 6.65) ++at;
  const double held = std::stod(all.at(at - 1).at(3));
  EXPECT_GT(held, 0.1) << "before the row that turns it past the angle";
  EXPECT_EQ(std::stod(all.at(at).at(6)), held)
      << "over the rim on the way there, and then the rest";
  EXPECT_GT(volume["dumped"], 0);
  EXPECT_LT(volume["dumped"], held);
  EXPECT_EQ(s["machines"][0]["bucket_m3"], 0);
  EXPECT_EQ(s["mass_kg"]["residual"], 0);
}

TEST_F(MovingSoil, ARowOfUpdatesSaysWhatWasSpilledAndSlid) {
  const json s = summary("all.yaml", "out");
  const auto all = rows("out");
  EXPECT_EQ(all.front(),
            (std::vector<std::string>{"time", "machine", "cut_m3", "bucket_m3", "update_us",
                                      "bucket_kg", "spilled_m3", "slid_m3"}));
  EXPECT_EQ(static_cast<double>(all.size()), s["updates"].get<double>() + 1);
  double spilled = 0, last_s = 0, most_m3 = 0;
  int poured = 0;
  for (std::size_t i = 1; i < all.size(); ++i) {
    spilled += std::stod(all[i].at(6));
    EXPECT_GE(std::stod(all[i][0]), last_s);
    last_s = std::stod(all[i][0]);
    if (all[i][1] == "digger") {
      EXPECT_NEAR(std::stod(all[i][5]), std::stod(all[i][3]) / 1.25 * 1800, 1e-6);
      most_m3 = std::max(most_m3, std::stod(all[i][3]));
      continue;
    }
    EXPECT_TRUE(all[i][1] == "truck" || all[i][1] == "tip");
    EXPECT_EQ(all[i][2] + all[i][3] + all[i][5], "000");
    ++poured;
  }
  EXPECT_EQ(poured, 16 + 1) << "parts of the one, all of the other";
  EXPECT_GT(most_m3, 0.2);
  EXPECT_NEAR(spilled, s["volume_m3"]["spilled"], 1e-3) << "but for what comes to rest at the end";
}

TEST_F(MovingSoil, APourComesDownEvenlyOverItsTime) {
  write("pour.yaml",
        std::string(kSoil) + "pours: [{name: truck, at: [0, 0, 2], time: [0, 4], volume: 0.32}]\n",
        "{plane: {z: 0}}", "{snapshots: {every: 1}}");
  summary("pour.yaml", "out");
  for (const int t : {1, 2, 3}) {
    const std::string said = good(fmt::format("info out/soil_{}.vdb", t)).out;
    const std::size_t at = said.find("loose");
    ASSERT_NE(at, std::string::npos) << said;
    EXPECT_NEAR(std::stod(said.substr(at + 5)), 0.08 * t, 1e-4);
  }
}

TEST_F(MovingSoil, RigidSoilSaysNothingOfIt) {
  write("rigid.yaml", kDigger);
  const json s = summary("rigid.yaml", "out");
  EXPECT_FALSE(s.contains("mass_kg"));
  EXPECT_EQ(keys(s["volume_m3"]),
            (std::vector<std::string>{"captured", "cut", "displaced", "dumped", "ground_change",
                                      "net_cut", "net_fill", "residual"}));
  EXPECT_NEAR(s["volume_m3"]["net_cut"], s["volume_m3"]["cut"], 1e-12);
  EXPECT_EQ(s["volume_m3"]["net_fill"], 0);
  EXPECT_EQ(keys(s["machines"][0]),
            (std::vector<std::string>{"bad_rows", "bucket_m3", "cut_m3", "name"}));
  EXPECT_EQ(rows("out").front().size(), 5);
  EXPECT_EQ(good("info out/soil_final.vdb").out.find("loose"), std::string::npos);
}

TEST_F(MovingSoil, PoursNeedNoMachinesAndTheRunLastsToTheEndOfTheLast) {
  write("pours.yaml", std::string(kSoil) + kPours);
  const json s = summary("pours.yaml", "out");
  EXPECT_EQ(s["mass_kg"]["residual"], 0);
  EXPECT_TRUE(s["machines"].empty());
  EXPECT_NEAR(s["volume_m3"]["fill"], 0.5 + s["volume_m3"]["slid"].get<double>(), 1e-2);
  EXPECT_EQ(s["acknowledged"]["time_s"], 6.5);
  good("verify out");
  EXPECT_NE(good("info out/soil_final.vdb").out.find("loose         0."), std::string::npos);
}

TEST_F(MovingSoil, APourMayLastLongerThanAllMotions) {
  write("late.yaml", std::string(kSoil) + kDigger +
                         "pours: [{name: truck, at: [4, 3, 2], time: [7, 11], volume: 0.1}]\n");
  const json s = summary("late.yaml", "out");
  EXPECT_EQ(s["acknowledged"]["time_s"], 11);
  EXPECT_NEAR(s["volume_m3"]["poured"], 0.1, 1e-6);
}

TEST_F(MovingSoil, AHopperTakesAllThatFallsIntoItWhileItIsThere) {
  const auto hauled = [&](const std::string& hopper) {
    // A truck that tips into a truck.
    write("hopper.yaml", std::string(kSoil) +
                             "pours: [{name: truck, at: [5, 0, 3], time: [0, 2], volume: 0.32}]\n"
                             "hoppers: [{name: truck, box: [3, -2, 7, 2], " +
                             hopper + "}]\n");
    const json s = summary("hopper.yaml", "out");
    EXPECT_EQ(s["mass_kg"]["residual"], 0);
    EXPECT_NEAR(s["mass_kg"]["hauled"].get<double>() + s["mass_kg"]["ground_change"].get<double>() +
                    s["mass_kg"]["in_flight"].get<double>(),
                s["mass_kg"]["poured"], 1e-9);
    return s["volume_m3"]["hauled"].get<double>();
  };
  EXPECT_NEAR(hauled("top: 1"), 0.32, 1e-6);
  EXPECT_NEAR(hauled("top: 1, time: [1, 9]"), 0.16 + 0.02, 1e-6) << "the part at 1 s, too";
  EXPECT_EQ(hauled("top: 1, time: [3, 9]"), 0);
  EXPECT_EQ(hauled("top: 3.5"), 0) << "it falls from below its rim";
}

TEST_F(MovingSoil, TheCapacityOfABucketIsSaidBeforeAndAfter) {
  const json capacity = summary("all.yaml", "out")["machines"][0]["capacity_m3"];
  // The profile's area and the hipped roof, by hand.
  const double struck = 0.78875 * 1.2,
               heaped = struck + 1.2 * 0.9 * 0.9 / 4 - std::pow(0.9, 3) / 12;
  EXPECT_NEAR(capacity["struck"], struck, 1e-9);
  EXPECT_NEAR(capacity["heaped"], heaped, 1e-9);
  EXPECT_NE(good("info all.yaml")
                .out.find(fmt::format("{:.4g} m³ struck, {:.4g} m³ heaped at 1:1", struck, heaped)),
            std::string::npos)
      << good("info all.yaml").out;
}

TEST_F(MovingSoil, RastersAndDifferencesHaveBothSigns) {
  write("all.yaml", std::string(kSoil) + kDigger + kPours + kHopper, "{plane: {z: 0}}",
        "{snapshots: {every: 2}, raster: {cell: 0.2}}");
  const json s = summary("all.yaml", "out");
  const json diff = json::parse(good("diff out/soil_2.vdb out/soil_final.vdb --json").out);
  EXPECT_GT(diff["cut_m3"], 0.1);
  EXPECT_GT(diff["fill_m3"], 0.1);
  EXPECT_TRUE(diff["exact"]);
  good("diff out/soil_2.vdb out/soil_final.vdb --to diff.tif");
  const auto sums = [&](const fs::path& file, double cell_m) {
    const io::RasterInput raster = io::open_raster(file);
    std::vector<float> z(static_cast<std::size_t>(raster.grid.nx * raster.grid.ny));
    raster.source->read(0, 0, raster.grid.nx, raster.grid.ny, z.data());
    std::pair<double, double> both;  // below, above
    for (const float v : z) (v < 0 ? both.first : both.second) += double{v} * cell_m * cell_m;
    return both;
  };
  const double cell_m = io::open_raster(folder() / "diff.tif").grid.spacing.x();
  const auto [fell, rose] = sums(folder() / "diff.tif", cell_m);
  // Within a cell both may happen, and cancel.
  EXPECT_LT(fell, -0.1);
  EXPECT_GT(rose, 0.1);
  EXPECT_NEAR(fell + rose, diff["net_m3"], 1e-5);
  if (shell("gdal_translate -q -b 2 out/soil_final.tif change.tif").status != 0)
    GTEST_SKIP() << "no gdal_translate";
  const auto [cut, fill] = sums(folder() / "change.tif", 0.2);
  EXPECT_LT(cut, -0.3);
  EXPECT_GT(fill, 0.3);
  EXPECT_NEAR(cut + fill, s["volume_m3"]["ground_change"], 1e-5);
}

TEST_F(MovingSoil, ALoadThatIsCarriedToTheEndIsWarnedOfOnce) {
  EXPECT_EQ(good("run all.yaml --out all").err, "");
  write("dig.yaml", std::string(kSoil) + kDigger);
  write_file(folder() / "dig.csv", dig_before("4.5"));
  const std::string said = good("run dig.yaml --out out").err;
  EXPECT_NE(said.find("digger carries its load to the end, 0."), std::string::npos) << said;
  EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1) << said;
  // Nor is one that can't dump warned of twice.
  write("open.yaml", std::string(kSoil) +
                         "machines: [{name: digger, motion: dig.csv, bucket: {width: 1.2, height: "
                         "0.9}}]\n");
  const std::string open = good("run open.yaml --out open").err;
  EXPECT_NE(open.find("never dumps"), std::string::npos) << open;
  EXPECT_EQ(std::count(open.begin(), open.end(), '\n'), 1) << open;
}

TEST_F(MovingSoil, LooseSoilStaysLooseInTheNextRun) {
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

}  // namespace earthmoving_run_test
}  // namespace soilvdb::test
