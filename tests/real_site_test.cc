// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The main job on real input: a 12 t excavator digs six loads out of a measured slope.
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <random>
#include <utility>

#include "tests/program.h"

namespace soilvdb::testing {
namespace {

using Pose = Eigen::Isometry3d;
using Eigen::Vector2d, Eigen::Vector3d;

fs::path shared() {
  const char* folder = std::getenv("SOILVDB_SHARED");
  return fs::weakly_canonical(folder ? fs::path(folder)
                                     : fs::path(SOILVDB_SOURCE_DIR) / "../shared");
}

// --- the machine as its maker describes it, not as the program reads it
// ---------------------------

constexpr double kWidth_m = 0.70, kHeight_m = 1.10;
const std::vector<Vector2d> kProfile = {
    {0, 0},        {-0.16, 0.095}, {-0.32, 0.245}, {-0.68, 0.53}, {-0.765, 0.64},
    {-0.79, 0.78}, {-0.775, 0.93}, {-0.72, 1.02},  {-0.60, 1.10}, {0, kHeight_m}};
constexpr std::array kBase = {321757.0, 4297525.0, 11.342, -0.129, 0.041, 0.349};
using Joints = std::array<double, 4>;  ///< swing, boom, arm, bucket, rad

Pose turn(double angle, const Vector3d& axis) { return Pose(Eigen::AngleAxisd(angle, axis)); }
Pose shift(double x, double y, double z) { return Pose(Eigen::Translation3d(x, y, z)); }

/// The bucket's mouth seen from the foot of the base: x east, y north.
Pose site_from_bucket(const Joints& q) {
  const Vector3d x = Vector3d::UnitX(), y = Vector3d::UnitY(), z = Vector3d::UnitZ();
  return shift(0, 0, kBase[2]) * turn(kBase[5], z) * turn(kBase[4], y) * turn(kBase[3], x) *
         shift(0, 0, 1) * turn(q[0], z) * shift(0.14, -0.16443, 0.424) *
         turn(1.57079632679 + q[1], y) * shift(0, 0, 4.6) * turn(q[2], y) * shift(0, 0, 2.519) *
         turn(q[3], y) * shift(0, 0, 1.23) * turn(std::numbers::pi, x);
}

struct Row {
  double time_s;
  Joints joints;
};

std::vector<Row> motion() {
  std::ifstream in(fs::path(SOILVDB_SOURCE_DIR) / "tests/data/zx120_dig.csv");
  std::vector<Row> rows;
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    Row row;
    if (std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf,%lf", &row.time_s, &row.joints[0],
                    &row.joints[1], &row.joints[2], &row.joints[3]) == 5)
      rows.push_back(row);
  }
  return rows;
}

/// Heights from the cells as gdal_translate lists them, bilinear between their centres.
class Heights {
 public:
  explicit Heights(const fs::path& ascii_grid) {
    std::ifstream in(ascii_grid);
    std::string key;
    for (double* value : {&nx_, &ny_, &west_, &south_, &cell_m_}) in >> key >> *value;
    if (in >> std::ws; std::isalpha(in.peek())) in >> key >> key;
    cells_.resize(static_cast<std::size_t>(nx_ * ny_));
    for (double& z : cells_) in >> z;
    good_ = static_cast<bool>(in);
  }
  bool good() const { return good_; }
  double operator()(double east, double north) const {
    const double u = (east - west_) / cell_m_ - 0.5, v = (north - south_) / cell_m_ - 0.5;
    const double i = std::floor(u), j = std::floor(v), a = u - i, b = v - j;
    return (1 - b) * ((1 - a) * at(i, j) + a * at(i + 1, j)) +
           b * ((1 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
  }

 private:
  double at(double i, double j) const {
    return cells_.at(static_cast<std::size_t>((ny_ - 1 - j) * nx_ + i));
  }
  double nx_ = 0, ny_ = 0, west_ = 0, south_ = 0, cell_m_ = 0;
  std::vector<double> cells_;
  bool good_ = false;
};

/// Is a point with x <= 0 inside the bucket? Seen from the side.
bool in_profile(const Vector3d& p) {
  bool inside = false;
  for (std::size_t i = 0, j = kProfile.size() - 1; i < kProfile.size(); j = i++) {
    const Vector2d &a = kProfile[i], &b = kProfile[j];
    if ((a.y() > p.z()) != (b.y() > p.z()) &&
        p.x() < a.x() + (p.z() - a.y()) / (b.y() - a.y()) * (b.x() - a.x()))
      inside = !inside;
  }
  return inside;
}

/// One point at random in each cell of the dig: those that the bucket ever reaches, load by load.
class Points {
 public:
  struct Volume {
    double cut_m3 = 0, captured_m3 = 0;
  };

  explicit Points(const Heights& heights) : reached_(kSide * kSide * kHigh) {
    for (std::size_t i = 0; i < kSide; ++i)
      for (std::size_t j = 0; j < kSide; ++j) {
        const Vector3d p = corner(i, j, 0);
        column_.push_back(heights(kBase[0] + p.x(), kBase[1] + p.y()));
      }
    heights_ = &heights;
  }

  /// The volume reached first between two poses that are close together.
  void sweep(const Pose& before, const Pose& after, Volume& volume) {
    Eigen::AlignedBox3d box;
    for (const Pose* pose : {&before, &after})
      for (const double y : {-kWidth_m / 2, kWidth_m / 2})
        for (const Vector2d& p : kProfile) box.extend(*pose * Vector3d(p.x(), y, p.y()));
    const Vector3d low = (box.min() - kLow) / kCell_m, high = (box.max() - kLow) / kCell_m;
    const Pose bucket_before = before.inverse(), bucket_after = after.inverse();
    for (std::size_t i = index(low.x(), kSide); i < index(high.x() + 1, kSide); ++i)
      for (std::size_t j = index(low.y(), kSide); j < index(high.y() + 1, kSide); ++j) {
        // The slope is well below 1: one cell more than the corner's height is above the ground.
        const double top = (column_[i * kSide + j] - kLow.z()) / kCell_m + 2;
        for (std::size_t k = index(low.z(), kHigh); k < index(std::min(high.z() + 1, top), kHigh);
             ++k)
          visit(i, j, k, bucket_before, bucket_after, volume);
      }
  }

 private:
  static constexpr std::size_t kSide = 640, kHigh = 128;
  static constexpr double kCell_m = 0.025;
  inline static const Vector3d kLow{-8, -8, 10.4};  ///< the tests below see if this is enough

  static std::size_t index(double at, std::size_t end) {
    return static_cast<std::size_t>(std::clamp(std::floor(at), 0.0, static_cast<double>(end)));
  }
  static Vector3d corner(std::size_t i, std::size_t j, std::size_t k) {
    return kLow + kCell_m * Vector3d(static_cast<double>(i), static_cast<double>(j),
                                     static_cast<double>(k));
  }

  void visit(std::size_t i, std::size_t j, std::size_t k, const Pose& bucket_before,
             const Pose& bucket_after, Volume& volume) {
    std::uint8_t& reached = reached_[(i * kSide + j) * kHigh + k];
    if (reached) return;
    std::minstd_rand random(static_cast<unsigned>(1 + (i * kSide + j) * kHigh + k));
    random.discard(3);
    std::uniform_real_distribution<> within(0, kCell_m);
    const double x = within(random), y = within(random), z = within(random);
    const Vector3d p = corner(i, j, k) + Vector3d(x, y, z);
    const Vector3d a = bucket_before * p, b = bucket_after * p;
    const double s = a.x() / (a.x() - b.x());  // where it meets the plane of the mouth
    const Vector3d m = a + s * (b - a);
    const bool through_mouth = a.x() > 0 && b.x() <= 0 && std::abs(m.y()) <= kWidth_m / 2 &&
                               m.z() >= 0 && m.z() <= kHeight_m;
    const bool in_body = std::abs(b.y()) <= kWidth_m / 2 && b.x() <= 0 && in_profile(b);
    if (!through_mouth && !in_body) return;
    if (p.z() >= (*heights_)(kBase[0] + p.x(), kBase[1] + p.y())) return;
    reached = 1;
    volume.cut_m3 += std::pow(kCell_m, 3);
    if (through_mouth) volume.captured_m3 += std::pow(kCell_m, 3);
  }

  const Heights* heights_ = nullptr;
  std::vector<double> column_;
  std::vector<std::uint8_t> reached_;
};

/// What each load must be, from the motion and the terrain alone. A load ends where the bucket
/// dumps, which it does on the far side.
std::vector<Points::Volume> true_loads(const Heights& heights) {
  constexpr int kSteps = 8;          // of at most 7 mm
  constexpr double kDumpSide = 1.0;  // rad of swing
  Points points(heights);
  std::vector<Points::Volume> loads(1);
  const std::vector<Row> rows = motion();
  Pose before = site_from_bucket(rows.front().joints);
  bool dumped = false;
  for (std::size_t r = 1; r < rows.size(); ++r)
    for (int k = 1; k <= kSteps; ++k) {
      Joints q;
      for (std::size_t i = 0; i < q.size(); ++i)
        q[i] = std::lerp(rows[r - 1].joints[i], rows[r].joints[i], static_cast<double>(k) / kSteps);
      const Pose after = site_from_bucket(q);
      points.sweep(before, after, loads.back());
      before = after;
      if (q[0] > kDumpSide) dumped = true;
      if (dumped && q[0] < kDumpSide) loads.emplace_back(), dumped = false;
    }
  return loads;
}

// --- the program
// ----------------------------------------------------------------------------------

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

class RealSite : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    if (!fs::exists(data_ / "dem/dtm.tif")) GTEST_SKIP() << "no " << data_;
  }
  Result good(const std::string& arguments) const {
    const Result result = run(arguments);
    EXPECT_EQ(result.status, 0) << arguments << ": " << result.err;
    EXPECT_EQ(result.err, "") << arguments;
    return result;
  }
  nlohmann::json good_json(const std::string& arguments) const {
    return nlohmann::json::parse(good(arguments).out, nullptr, false);
  }
  bool there_is(const std::string& program) const {
    return shell("command -v " + program).status == 0;
  }

  const fs::path data_ = shared() / "data";
};

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
  for (const char* suffix : {"ply", "obj", "stl", "glb", "tif", "png", "vdb"}) {
    good(fmt::format("export {} --to x.{}", final(), suffix));
    EXPECT_GT(fs::file_size(folder() / fmt::format("x.{}", suffix)), 10'000u) << suffix;
  }
  good(fmt::format("export {} --to view.png --view perspective", final()));
  EXPECT_EQ(read_file(folder() / "view.png").substr(1, 3), "PNG");
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

// --- other terrain models
// -------------------------------------------------------------------------

class RealTerrain : public RealSite {
 protected:
  /// A bucket goes 0.3 m into level ground at a place, along x for 2 m, and out again.
  void write_dig(const std::string& raster, double x_m, double y_m, double z_m) const {
    std::string csv = "time,x,y,z,pitch\n";
    for (int i = 0; i <= 40; ++i) {
      const double s = i / 40.0;
      csv += fmt::format("{},{},{},{},{}\n", 4 * s, x_m + 2 * s, y_m,
                         z_m + 0.2 - 0.5 * std::sin(std::numbers::pi * s), -0.3);
    }
    write_file(folder() / "dig.csv", csv);
    write_file(folder() / "dig.yaml",
               fmt::format("soilvdb: 1\nname: dig\nvoxel_size: 0.05\nterrain: {{raster: "
                           "{}/dem/{}}}\nmachines:\n  - name: digger\n    bucket: {{width: 0.7, "
                           "height: 1.1}}\n    motion: dig.csv\n",
                           data_.string(), raster));
  }
  /// Of about 2 m x 0.7 m x 0.17 m, on ground that isn't quite level.
  void expect_cut() const {
    const auto volume = read_json(folder() / "out/dig/summary.json")["volume_m3"];
    ASSERT_TRUE(volume.is_object());
    EXPECT_NEAR(volume["cut"], 0.21, 0.1);
    EXPECT_LT(std::abs(volume["residual"].get<double>()), 1e-9);
  }
};

TEST_F(RealTerrain, ARasterWithoutCrsIsDugInMetres) {
  write_dig("DEM-kootenai_37x50_1x1.asc", 556481, 5394935.5, 539.4);
  good("run dig.yaml");
  expect_cut();
}

TEST_F(RealTerrain, AGullyWithNodataZeroIsDugWhereItHasHeights) {
  write_dig("west_bijou_gully.asc", 559733.5, 4380458.5, 1724.603);
  good("run dig.yaml");
  expect_cut();
}

TEST_F(RealTerrain, AGullyWithNodataZeroIsNotDugAtItsEdge) {
  write_dig("west_bijou_gully.asc", 559793, 4380479.5, 1725.43);  // heights end at 559793.5
  expect_refused("run dig.yaml", "without a height");
}

TEST_F(RealTerrain, UndeclaredNodataIsNoGroundEither) {
  write_dig("hugo_site_filled.asc", 235, 285, 1707);
  run("run dig.yaml");
  expect_cut();
  fs::remove_all(folder() / "out");
  write_dig("hugo_site_filled.asc", 384, 524, 1708);  // heights end at 385
  expect_refused("run dig.yaml", "without a height");
  write_dig("hugo_site_filled.asc", 5, 5, -9999);
  expect_refused("run dig.yaml", "without a height");
}

}  // namespace
}  // namespace soilvdb::testing
