// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The main job on real input: a 12 t excavator digs six loads out of a measured slope.
#include "tests/program/real_site_fixture.h"
#include "tests/program/zx120.h"

namespace soilvdb::test {
namespace real_site_test {

std::string dig_scenario(const fs::path& data) {
  std::string profile;
  for (const Vector2d& p : kProfile)
    profile += fmt::format("{}[{}, {}]", profile.empty() ? "" : ", ", p.x(), p.y());
  return fmt::format(
      "soilvdb: 1\nname: zx120-dig\nvoxel_size: 0.05\nterrain: {{raster: {0}/dem/dtm.tif}}\n"
      "machines:\n  - name: zx120\n    bucket: {{width: {1}, height: {2}, profile: [{3}], "
      "dump_angle: 0.9}}\n    motion: {4}/tests/data/zx120_dig.csv\n"
      "    urdf: {0}/machine/zx120/zx120.urdf\n    base: {{xyz: [{5}, {6}, {7}], rpy: [{8}, {9}, "
      "{10}]}}\n    lip: {{link: bucket_link, xyz: [0, 0, 1.23], rpy: [3.141592653589793, 0, 0]}}\n"
      "output: {{snapshots: {{every: 60}}, mesh: ply, raster: {{cell: 0.1}}}}\n",
      data.string(), kWidth_m, kHeight_m, profile, SOILVDB_SOURCE_DIR, kBase[0], kBase[1], kBase[2],
      kBase[3], kBase[4], kBase[5]);
}

/// The dig is run once, and looked at by each test.
class RealDig : public RealSite {
 protected:
  void SetUp() override {
    RealSite::SetUp();
    if (IsSkipped()) return;
    write_file(folder() / "zx120.yaml", dig_scenario(data_));
    static const test::TempFolder once;
    out_ = once.path() / "dig";
    if (!fs::exists(out_))
      good(fmt::format("run zx120.yaml --threads 2 --out '{}'", out_.string()));
    summary_ = read_json(out_ / "summary.json");
    ASSERT_TRUE(summary_.is_object());
  }
  std::string final() const { return fmt::format("'{}'", (out_ / "soil_final.vdb").string()); }

  /// What the bucket holds each time before it is emptied.
  std::vector<double> loads() const {
    std::istringstream csv(read_file(out_ / "updates.csv"));
    std::string line;
    std::getline(csv, line);
    std::vector<double> loads;
    double held_m3 = 0;
    while (std::getline(csv, line)) {
      double now_m3 = 0;
      if (std::sscanf(line.c_str(), "%*f,zx120,%*f,%lf", &now_m3) != 1) return {};
      if (held_m3 > 0 && now_m3 == 0) loads.push_back(held_m3);
      held_m3 = now_m3;
    }
    return loads;
  }

  fs::path out_;
  nlohmann::json summary_;
};

TEST_F(RealDig, CutsTheVolumeThatTheMotionReaches) {
  ASSERT_EQ(shell(fmt::format("gdal_translate -q -of AAIGrid '{}' dtm.asc",
                              (data_ / "dem/dtm.tif").string()))
                .status,
            0);
  const Heights heights(folder() / "dtm.asc");
  ASSERT_TRUE(heights.good());
  const std::vector<Points::Volume> truth = true_loads(heights);
  const std::vector<double> booked = loads();
  ASSERT_EQ(booked.size(), 6u);
  ASSERT_GE(truth.size(), booked.size());

  // One point in each cell of 2.5 cm: only the cells that the surface of the cut passes through
  // err, 3 / h^2 per square metre at most, each with a variance of h^6 / 4 at most.
  constexpr double kLoadSurface_m2 = 5, kCell_m = 0.025, kEngine = 0.005;
  const auto sampling_m3 = [&](double surface_m2) {
    return 3 * kCell_m * kCell_m * std::sqrt(3 * surface_m2 / 4);
  };
  double cut_m3 = 0, captured_m3 = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    cut_m3 += truth[i].cut_m3;
    captured_m3 += truth[i].captured_m3;
    if (i >= booked.size()) continue;
    const double load_m3 = truth[i].captured_m3;
    EXPECT_NEAR(booked[i], load_m3, kEngine * load_m3 + sampling_m3(kLoadSurface_m2)) << i;
    EXPECT_GT(booked[i], 0.3) << i;  // the bucket's struck capacity is 0.43 m3
    EXPECT_LT(booked[i], 0.6) << i;
  }
  const auto& volume = summary_["volume_m3"];
  const double tolerance_m3 = kEngine * cut_m3 + sampling_m3(6 * kLoadSurface_m2);
  EXPECT_NEAR(volume["cut"], cut_m3, tolerance_m3);
  EXPECT_NEAR(volume["captured"], captured_m3, tolerance_m3);
  RecordProperty("true_cut_m3", std::to_string(cut_m3));
  RecordProperty("true_captured_m3", std::to_string(captured_m3));
}

TEST_F(RealDig, TheLedgerCloses) {
  const auto& volume = summary_["volume_m3"];
  EXPECT_LT(std::abs(volume["residual"].get<double>()), 1e-9);
  EXPECT_NEAR(volume["ground_change"], -volume["cut"].get<double>(), 1e-9);
  EXPECT_NEAR(volume["captured"].get<double>() + volume["displaced"].get<double>(), volume["cut"],
              1e-9);
  EXPECT_NEAR(volume["dumped"], volume["captured"], 1e-9);             // it ends empty
  EXPECT_LT(volume["displaced"], 0.02 * volume["cut"].get<double>());  // the bottom plate is clear
}

TEST_F(RealDig, SameBitsWithOneThread) {
  good("run zx120.yaml --threads 1 --out one");
  EXPECT_EQ(read_json(folder() / "one/summary.json")["state_hash"], summary_["state_hash"]);
}

TEST_F(RealDig, SnapshotsInTheMiddleOfAPassDoNotChangeTheGround) {
  good("run zx120.yaml --no-snapshots --no-mesh --out none");
  EXPECT_EQ(read_json(folder() / "none/summary.json")["state_hash"], summary_["state_hash"]);
}

TEST_F(RealDig, InfoKnowsEveryFile) {
  for (const char* name : {"soil_60.vdb", "soil_120.vdb", "soil_final.vdb", "soil_final.tif"})
    EXPECT_NE(good(fmt::format("info '{}'", (out_ / name).string())).out.find("26918"),
              std::string::npos)
        << name;
  EXPECT_NE(good("info zx120.yaml").out.find("zx120"), std::string::npos);
  good(fmt::format("info '{}'", (data_ / "dem/dtm.tif").string()));
}

TEST_F(RealDig, ExportsEveryFormat) {
  for (const char* suffix : {"ply", "glb", "tif", "png", "vdb"}) {
    good(fmt::format("export {} --to x.{}", final(), suffix));
    EXPECT_GT(fs::file_size(folder() / fmt::format("x.{}", suffix)), 10'000u) << suffix;
  }
  good(fmt::format("export '{}' --to early.ply", (out_ / "soil_60.vdb").string()));
  EXPECT_LT(fs::file_size(folder() / "early.ply"), fs::file_size(folder() / "x.ply"));
  if (!there_is("vdb_print")) GTEST_SKIP() << "no vdb_print";
  const std::string print = shell("vdb_print -l x.vdb").out;
  for (const char* word : {"surface", "level set", "0.05", "float"})
    EXPECT_NE(print.find(word), std::string::npos) << print;
}

TEST_F(RealDig, DiffIsWhatTheLedgerBookedBetween) {
  std::istringstream csv(read_file(out_ / "updates.csv"));
  std::string line;
  std::getline(csv, line);
  double between_m3 = 0, time_s = 0, cut_m3 = 0;
  while (std::getline(csv, line)) {
    ASSERT_EQ(std::sscanf(line.c_str(), "%lf,zx120,%lf", &time_s, &cut_m3), 2) << line;
    if (time_s > 60 && time_s <= 120) between_m3 += cut_m3;
  }
  const auto diff =
      good_json(fmt::format("diff '{0}/soil_60.vdb' '{0}/soil_120.vdb' --json "
                            "--to diff.tif",
                            out_.string()));
  EXPECT_GT(between_m3, 0.5);
  EXPECT_NEAR(diff["cut_m3"], between_m3, 1e-9);
  EXPECT_EQ(diff["fill_m3"], 0);
  good(fmt::format("diff '{}/soil_60.vdb' {} --to diff.png", out_.string(), final()));
}

TEST_F(RealDig, TheRasterLiesWhereTheDigIs) {
  if (!there_is("gdalinfo")) GTEST_SKIP() << "no gdalinfo";
  const auto info = nlohmann::json::parse(
      shell(fmt::format("gdalinfo -json -stats '{}'", (out_ / "soil_final.tif").string())).out,
      nullptr, false);
  ASSERT_TRUE(info.is_object());
  EXPECT_NE(info["coordinateSystem"]["wkt"].get<std::string>().find("26918"), std::string::npos);
  EXPECT_EQ(info["geoTransform"][1], 0.1);
  // Around every place the lip gets to below the ground, and little beyond what the arm reaches.
  const auto west = info["cornerCoordinates"]["lowerLeft"][0].get<double>();
  const auto south = info["cornerCoordinates"]["lowerLeft"][1].get<double>();
  const auto east = info["cornerCoordinates"]["upperRight"][0].get<double>();
  const auto north = info["cornerCoordinates"]["upperRight"][1].get<double>();
  constexpr double kReach_m = 9, kMargin_m = 2;
  EXPECT_GT(west, kBase[0] - kMargin_m);
  EXPECT_LT(east, kBase[0] + kReach_m);
  EXPECT_GT(south, kBase[1] - kReach_m);
  EXPECT_LT(north, kBase[1] + kReach_m);
  const double cells = (east - west) * (north - south) / 0.01;
  const auto& change = info["bands"][1];
  EXPECT_EQ(change["description"], "change");
  const double mean_m = change["mean"];
  const double share =
      std::stod(change["metadata"][""].value("STATISTICS_VALID_PERCENT", std::string("100")));
  EXPECT_NEAR(mean_m * cells * share / 100 * 0.01, -summary_["volume_m3"]["cut"].get<double>(),
              0.02 * summary_["volume_m3"]["cut"].get<double>());
}

}  // namespace real_site_test
}  // namespace soilvdb::test
