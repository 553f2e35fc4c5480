// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scans in a scenario: what they correct, how a run goes on, and what is refused.
#include <fmt/format.h>

#include <cmath>
#include <random>

#include "soilvdb/height_map.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/io/snapshot.h"
#include "tests/program/resume_fixture.h"
#include "tests/support/scan_messages_fixture.h"

namespace soilvdb::test {
namespace scan_run_test {

class ScanRun : public Resume {
 protected:
  /// A dig on a plane whose lip is told 3 cm too high, and two scans of the true ground: of the
  /// plane beside it and of the floor 3 cm deeper than the machine says.
  void SetUp() override {
    Resume::SetUp();
    std::string csv = "time,x,y,z\n";
    for (int i = 0; i <= 40; ++i)
      csv += fmt::format("{},{},0,{}\n", 0.1 * i, 0.05 * i, i < 5 ? 0.2 - 0.08 * i : -0.2);
    csv += "4.5,4,3,2\n5,4,3,2\n";
    write_file(folder() / "dig.csv", csv);
    std::mt19937_64 random(1);
    std::normal_distribution<double> noise(0, 0.005);
    std::string points = "x,y,z\n";
    for (double x = -1; x < 3; x += 0.02)
      for (double y = -1.5; y < 1.5; y += 0.02) {
        const bool floor = x > 0.4 && x < 1.9 && std::abs(y) < 0.5;
        if (floor || std::abs(y) > 0.8)
          points +=
              fmt::format("{:.4f},{:.4f},{:.4f}\n", x, y, (floor ? -0.23 : 0) + noise(random));
      }
    write_file(folder() / "floor.csv", points);
    write(kScans);
  }
  static constexpr const char* kScans =
      "sensors:\n  mast: {at: [1, -4, 4], noise: {range: 0.005}}\n"
      "scans:\n"
      "  - {sensor: mast, file: floor.csv, time: 4.8, frame: world}\n"
      "  - {sensor: mast, file: floor.csv, time: 4.9, frame: world}\n";

  void write(const std::string& scans, const std::string& known = "") const {
    write_file(folder() / "dig.yaml",
               fmt::format("soilvdb: 1\nvoxel_size: 0.05\nterrain: {{plane: {{z: 0}}}}\n"
                           "machines:\n  - name: digger\n    bucket: {{width: 1.2, height: 0.9}}\n"
                           "    motion: dig.csv\n{}"
                           "{}output: {{snapshots: {{every: 1}}, mesh: ply, journal: {{sync: "
                           "always}}}}\n",
                           known, scans));
  }
  /// The seen floor is 3 cm deeper, and some of the unseen floor about it, but not more than all.
  static void expect_floor(const nlohmann::json& volumes) {
    EXPECT_GT(volumes["surveyed_removed"].get<double>(), 0.03 * 1.5 * 1.0 - 0.01);
    EXPECT_LT(volumes["surveyed_removed"].get<double>(), 0.03 * 1.75 * 1.2);
  }
  void expect_refused_line(const std::string& scans, const std::string& words) const {
    write(scans);
    const Result result = run("run dig.yaml");
    EXPECT_EQ(result.status, 2) << scans;
    EXPECT_NE(result.err.find(words), std::string::npos) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_FALSE(fs::exists(out()));
  }
};

// README's scans: of a lip that is told 3 cm too high, and soil that slid and nobody told of.
// Ground that one scan found, and those at its edges, say nothing of the lip to the next.
TEST_F(ScanRun, FindsTheLipHoweverOftenASlumpIsSeen) {
  const fs::path data = fs::path(SOILVDB_SOURCE_DIR) / "data";
  for (const auto& entry : fs::directory_iterator(data))
    if (entry.is_regular_file())
      fs::create_symlink(entry.path(), folder() / entry.path().filename());
  std::string scenario = read_file(data / "scanned.yaml");
  for (int n = 0; n < 6; ++n)
    scenario += fmt::format("  - {{sensor: drone, file: slump_{}.ply, time: {}}}\n", n % 3 + 1,
                            130.41 + 0.01 * n);
  write_file(folder() / "often.yaml", scenario);
  for (const char* file : {"scanned.yaml", "often.yaml"}) {
    SCOPED_TRACE(file);
    good(fmt::format("run {} --no-mesh --out found", file));
    const auto lip = read_json(folder() / "found/summary.json")["machines"][0]["lip_error_m"];
    const double sigma = lip["sigma"];
    EXPECT_LT(sigma, 0.012);
    EXPECT_NEAR(lip["mean"].get<double>(), 0.03, 2 * sigma);
    fs::remove_all(folder() / "found");
  }
}

// The raster of a run with scans says how well each height is known, and what was seen.
TEST_F(ScanRun, WritesSigmasAndWhatWasSeen) {
  write(kScans);
  std::string scenario = read_file(folder() / "dig.yaml");
  scenario.replace(scenario.find("mesh: ply"), 9, "raster: {cell: 0.05}");
  write_file(folder() / "dig.yaml", scenario);
  good("run dig.yaml");
  if (shell("gdal_translate -q -b 3 out/dig/soil_final.tif sigma.tif").status != 0)
    GTEST_SKIP() << "no gdal_translate";
  ASSERT_EQ(shell("gdal_translate -q -b 4 out/dig/soil_final.tif surveyed.tif").status, 0);
  const std::string about = shell("gdalinfo out/dig/soil_final.tif").out;
  for (const char* words : {"Description = sigma", "Description = surveyed"})
    EXPECT_NE(about.find(words), std::string::npos) << about;
  EXPECT_EQ(about.find("Band 5"), std::string::npos);
  const auto read = [&](const char* name) {
    const io::RasterInput raster = io::open_raster(folder() / name);
    std::vector<float> values(static_cast<std::size_t>(raster.grid.nx * raster.grid.ny));
    raster.source->read(0, 0, raster.grid.nx, raster.grid.ny, values.data());
    return std::pair{raster.grid, values};
  };
  const auto [grid, sigma] = read("sigma.tif");
  const auto [same, surveyed] = read("surveyed.tif");
  int counts[4] = {};
  for (int j = 0; j < grid.ny; ++j) {
    for (int i = 0; i < grid.nx; ++i) {
      const double x = grid.first.x() + 0.05 * i, y = grid.first.y() + 0.05 * j;
      const auto n = static_cast<std::size_t>(j * grid.nx + i);
      const bool on_floor = x > 0.45 && x < 1.85;
      if (x > -0.95 && x < 2.95 && y > 0.85 && y < 1.45) {  // the plane, which the scans saw
        EXPECT_EQ(surveyed[n], 1) << x << " " << y;
        EXPECT_LT(sigma[n], 0.01);
        ++counts[0];
      } else if (x < 1.9 && y > 0.7 && y < 0.75) {  // and did not see
        EXPECT_EQ(surveyed[n], 0) << x << " " << y;
        EXPECT_LT(sigma[n], 0.01 + 1e-6);
        EXPECT_GT(sigma[n], 0.01 * std::sqrt(0.5));  // half errs by itself
        ++counts[1];
      } else if (on_floor && std::abs(y) < 0.45) {
        EXPECT_EQ(surveyed[n], 1) << x << " " << y;
        EXPECT_LT(sigma[n], 0.0075);
        ++counts[2];
      } else if (on_floor && y > 0.51 && y < 0.54) {  // hidden floor: 3 cm too high
        EXPECT_EQ(surveyed[n], 0) << x << " " << y;
        EXPECT_GT(sigma[n], 0.03 / 1.5);
        EXPECT_LT(sigma[n], 0.03 * 1.5);
        ++counts[3];
      }
    }
  }
  for (const int count : counts) EXPECT_GT(count, 20);
  good("export out/dig/soil_final.vdb --to two.tif");
  EXPECT_NE(shell("gdal_translate -q -b 3 two.tif third.tif").status, 0);
}

TEST_F(ScanRun, CorrectsTheFloorAndFindsTheLip) {
  const Result result = good("run dig.yaml");
  EXPECT_NE(result.out.find("surveyed"), std::string::npos) << result.out;
  const nlohmann::json all = summary(), volumes = all["volume_m3"];
  expect_floor(volumes);
  EXPECT_LT(volumes["surveyed_added"].get<double>(), 0.005);
  EXPECT_NEAR(volumes["residual"].get<double>(), 0, 1e-9);
  const nlohmann::json lip = all["machines"][0]["lip_error_m"];
  EXPECT_NEAR(lip["mean"].get<double>(), 0.03, 0.012);
  for (const std::string& told :
       {fmt::format("\nlip error   {:.3f} ± {:.3f} m digger, as told less the true\n",
                    lip["mean"].get<double>(), lip["sigma"].get<double>()),
        std::string("\nbalance     0 m³\n")})
    EXPECT_NE(result.out.find(told), std::string::npos) << told << result.out;
  EXPECT_GT(lip["sigma"].get<double>(), 0.002);
  EXPECT_LT(lip["sigma"].get<double>(), 0.01);
  EXPECT_EQ(updates().size(), 44u) << "a row for each of the machine's, and the heading";
}

TEST_F(ScanRun, IsSaidByInfo) {
  const std::string out = good("info dig.yaml").out;
  EXPECT_NE(out.find("mast: at x 1.00, y -4.00, z 4.00 m, noise 0.005 m\n"), std::string::npos)
      << out;
  EXPECT_NE(out.find("2 scans, 4.8 s to 4.9 s, from floor.csv\n"), std::string::npos) << out;
}

TEST_F(ScanRun, GoesOnFromAnyPlace) {
  for (const double share : {0.5, 0.99}) {
    run_part(share);
    expect_goes_on_to_the_same();
    fs::remove_all(out());
  }
}

// A scan may see nothing but the bucket.
TEST_F(ScanRun, GoesOnAfterScansWithoutRays) {
  write_file(folder() / "bucket.csv", "x,y,z\n4,3,2.3\n4.01,3,2.3\n");
  write(std::string(kScans) + "  - {sensor: mast, file: bucket.csv, time: 4.95, frame: world}\n");
  run_part(0.99);
  expect_goes_on_to_the_same();
}

TEST_F(ScanRun, TakesWhatIsKnownOfTheLip) {
  write(kScans, "    known: {lip: 0.001}\n");
  good("run dig.yaml");
  const nlohmann::json lip = summary()["machines"][0]["lip_error_m"];
  EXPECT_LT(std::abs(lip["mean"].get<double>()), 0.003);
}

TEST_F(ScanRun, RefusesWhatIsNoScan) {
  expect_refused_line("scans:\n  - {sensor: mast, file: floor.csv, time: 1}\n",
                      "dig.yaml:9: there is no sensor 'mast'");
  expect_refused_line("sensors: {mast: {at: [0, 0, 4], noise: {range: -1}}}\n", "range is -1");
  expect_refused_line("sensors: {mast: {at: [0, 0, 4], noise: ouster}}\n",
                      "the noise of 'ouster' is not known; known are ouster_os1, realsense_d435, "
                      "realsense_d455. Or give the sigmas of its ranges\n");
  expect_refused_line("sensors: {mast: {at: [0, 0, 4], mast: 3}}\n", "unknown");
  expect_refused_line("sensors: {mast: {machine: diger}}\n", "there is no machine 'diger'");
  expect_refused_line("sensors: {mast: {machine: digger, link: boom}}\n", "no 'urdf'");
  expect_refused_line(
      "sensors: {mast: {at: [0, 0, 4]}}\nscans:\n  - {sensor: mast, file: none.ply, time: 1}\n",
      "none.ply");
  expect_refused_line(
      "sensors: {mast: {at: [0, 0, 4]}}\nscans:\n  - {sensor: mast, file: "
      "floor.csv, time: 1, frame: lidar}\n",
      "it must be world or sensor");
}

/// As ScanRun, and a lidar's recording of the same true ground: five scans from 4.6 s on, each from
/// another place that the transforms say.
class RecordedScanRun : public ScanRun {
 protected:
  void SetUp() override {
    ScanRun::SetUp();
    std::mt19937_64 random(2);
    std::normal_distribution<double> noise(0, 0.005);
    io::Recording recording(folder() / "drive.mcap");
    std::string csv;
    for (int n = 0; n < 5; ++n) {
      const double time_s = 4.6 + 0.1 * n;
      const v0::Pose at{{1 + 0.1 * n, -3, 3}, from_rpy(0.1 * n, 0.2, 1.5)};
      io::CloudMessage cloud;
      cloud.height = 1;
      csv = "x,y,z\n";
      for (double x = -1; x < 3; x += 0.03)
        for (double y = -1.5; y < 1.5; y += 0.03) {
          const bool floor = x > 0.4 && x < 1.9 && std::abs(y) < 0.5;
          if (!floor && std::abs(y) < 0.8) continue;
          const Vec3 point = at.inverse() * Vec3(x, y, (floor ? -0.23 : 0) + noise(random));
          ++cloud.width;
          const Eigen::Vector3f p = point.cast<float>();
          cloud.data += io::bytes_of(false, p.x(), p.y(), p.z());
          csv += fmt::format("{:.9g},{:.9g},{:.9g}\n", p.x(), p.y(), p.z());
        }
      cloud.row_step = cloud.width * cloud.point_step;
      write_file(folder() / fmt::format("scan{}.csv", n), csv);
      recording.message("/lidar/points", "sensor_msgs/msg/PointCloud2", cloud.cdr(time_s, "lidar"),
                        time_s);
      if (n < 4)  // of the last one nothing tells the place
        recording.message("/tf", "tf2_msgs/msg/TFMessage", transform(time_s, at), time_s);
      places.push_back(at);
    }
    recording.close();
  }
  static io::CdrWriter transform(double time_s, const v0::Pose& pose) {
    io::CdrWriter cdr;
    cdr.put(std::uint32_t{1});
    const auto ns = std::llround(time_s * 1e9);
    cdr.put(static_cast<std::int32_t>(ns / 1'000'000'000));
    cdr.put(static_cast<std::uint32_t>(ns % 1'000'000'000));
    cdr.put(std::string_view("map"));
    cdr.put(std::string_view("lidar"));
    const Vec3& p = pose.position;
    const Eigen::Quaterniond& q = pose.rotation;
    cdr.put_all(p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w());
    return cdr;
  }
  static std::string sensor(const std::string& place) {
    return fmt::format("sensors:\n  mast: {{{}noise: {{range: 0.005}}}}\n", place);
  }
  std::vector<v0::Pose> places;
};

TEST_F(RecordedScanRun, IsThatOfFilesWithTheSamePoints) {
  write(sensor("") + "scans: [{sensor: mast, mcap: drive.mcap, topic: /lidar/points}]\n");
  const Result recorded = good("run dig.yaml");
  EXPECT_NE(recorded.err.find("where frame 'lidar' is at the time of 1 scan; left out"),
            std::string::npos)
      << recorded.err;
  const std::string moves = "dig.yaml:10: sensor 'mast' moves, and each of its poses is believed";
  EXPECT_NE(recorded.err.find(moves), std::string::npos) << recorded.err;
  const nlohmann::json volumes = summary()["volume_m3"];
  expect_floor(volumes);
  // Each as a file, by a sensor of the same name and noise; its place as well.
  std::string sensors = "sensors:\n", scans = "scans:\n";
  for (int n = 0; n < 4; ++n) {
    const v0::Pose& at = places[static_cast<std::size_t>(n)];
    const Eigen::Vector4d q = at.rotation.coeffs();
    sensors += fmt::format(
        "  mast{}: {{at: [{:.17g}, {:.17g}, {:.17g}], rotation: [{:.17g}, {:.17g}, {:.17g}, "
        "{:.17g}], noise: {{range: 0.005}}}}\n",
        n, at.position.x(), at.position.y(), at.position.z(), q.x(), q.y(), q.z(), q.w());
    scans +=
        fmt::format("  - {{sensor: mast{}, file: scan{}.csv, time: {}}}\n", n, n, 4.6 + 0.1 * n);
  }
  fs::remove_all(out());
  write(sensors + scans);
  good("run dig.yaml");
  EXPECT_NEAR(summary()["volume_m3"]["surveyed_removed"].get<double>(),
              volumes["surveyed_removed"].get<double>(), 0.002)
      << "four sensors' mounts instead of one's";
}

TEST_F(RecordedScanRun, IsWarnedOfIfItsSensorMovesAndNoAccuracyOfItsPosesIsKnown) {
  const auto warned = [&](const std::string& of_sensor, const std::string& of_scan) {
    write(sensor(of_sensor) + "scans: [{sensor: mast, mcap: drive.mcap, topic: /lidar/points" +
          of_scan + "}]\n");
    const std::string told = run("info dig.yaml").out;
    return told.find("sensor 'mast' moves") != told.npos;
  };
  EXPECT_TRUE(warned("", ""));
  EXPECT_FALSE(warned("", ", every: 100")) << "one scan";
  EXPECT_FALSE(warned("at: [0, 0, 3], ", ""));
  EXPECT_FALSE(warned("pose: {shift: 0.01}, ", ""));
}

TEST_F(RecordedScanRun, IsPlacedByItsSensorIfThatHasAPlace) {
  const Vec3 at = places[0].position;
  const Eigen::Vector4d q = places[0].rotation.coeffs();
  const std::string place = fmt::format(
      "at: [{:.17g}, {:.17g}, {:.17g}], rotation: [{:.17g}, {:.17g}, {:.17g}, {:.17g}], ", at.x(),
      at.y(), at.z(), q.x(), q.y(), q.z(), q.w());
  // Only the first scan is from there.
  write(sensor(place) +
        "scans: [{sensor: mast, mcap: drive.mcap, topic: /lidar/points, every: 100}]\n");
  good("run dig.yaml");
  const double by_recording = summary()["volume_m3"]["surveyed_removed"].get<double>();
  fs::remove_all(out());
  write(sensor(place) + "scans: [{sensor: mast, file: scan0.csv, time: 4.6}]\n");
  good("run dig.yaml");
  EXPECT_EQ(summary()["volume_m3"]["surveyed_removed"].get<double>(), by_recording);
  EXPECT_GT(by_recording, 0.02);
}

TEST_F(RecordedScanRun, GoesOnFromAnyPlace) {
  write(sensor("") + "scans: [{sensor: mast, mcap: drive.mcap, topic: /lidar/points}]\n");
  run_part(0.96);
  expect_goes_on_to_the_same();
}

TEST_F(RecordedScanRun, LeavesOutWhatIsFromBeforeItsMachineHasAPlace) {
  io::Recording recording(folder() / "bucket.mcap");
  for (const double time_s : {1.0, 4.7})
    recording.message("/camera", "sensor_msgs/msg/PointCloud2", io::CloudMessage{}.cdr(time_s, "c"),
                      time_s);
  recording.close();
  std::string csv = read_file(folder() / "dig.csv");
  csv.replace(csv.find("\n0,") + 1, csv.find("\n1.5,") - csv.find("\n0,"), "");
  write_file(folder() / "dig.csv", csv);
  write(sensor("machine: digger, ") +
        "scans: [{sensor: mast, mcap: bucket.mcap, topic: /camera}]\n");
  const Result result = good("run dig.yaml");
  EXPECT_NE(
      result.err.find("1 scan is from before 'digger', which carries the sensor, has a place; "
                      "left out"),
      std::string::npos)
      << result.err;
}

/// A machine that drives along x at 1 m/s carries a lidar 4 m above the ground.
class CarriedScanRun : public ScanRun {
 protected:
  static constexpr double kScan_s = 4.515;

  void SetUp() override {
    ScanRun::SetUp();
    std::string csv = "time,x,y,z\n";
    for (int i = 0; i <= 500; ++i) csv += fmt::format("{0},{0},0,3\n", 0.02 * i);
    write_file(folder() / "dig.csv", csv);
    std::string points = "x,y,z\n";
    for (double x = -1; x < 1; x += 0.01)
      for (double y = -1; y < 1; y += 0.01)
        points += fmt::format("{:.4f},{:.4f},{}\n", x, y, std::abs(x) < 0.5 ? -4.3 : -4.0);
    write_file(folder() / "below.csv", points);
    write(fmt::format(
        "sensors: {{mast: {{machine: digger, at: [1, 0, 1], noise: {{range: 0.005}}}}}}\n"
        "scans: [{{sensor: mast, file: below.csv, time: {}}}]\n",
        kScan_s));
  }
};

TEST_F(CarriedScanRun, IsWarnedOfWithoutAnAccuracyOfItsPoses) {
  const std::string place = "at: [1, 0, 1], noise: {range: 0.005}";
  const auto warned = [&](const std::string& sensor) {
    write("sensors: {mast: {" + sensor + "}}\nscans: [{sensor: mast, file: below.csv, time: 4}]\n");
    const std::string told = run("info dig.yaml").out;
    const std::string words =
        "dig.yaml:8: sensor 'mast' moves with 'digger', and each of its poses is believed to the "
        "last millimetre; give their standard deviations in m and rad, such as 'pose: {shift: 0.02";
    return told.find(words) != told.npos;
  };
  EXPECT_TRUE(warned("machine: digger, " + place));
  EXPECT_FALSE(warned(place));
  for (const char* known : {"{shift: 0.01}", "{turn: 0.01}"})
    EXPECT_FALSE(warned("machine: digger, " + place + ", pose: " + known)) << known;
}

/// A scan of which most points are so far apart that scans would see too much ground.
class FarScanRun : public ScanRun {
 protected:
  void SetUp() override {
    ScanRun::SetUp();
    std::string points = read_file(folder() / "floor.csv");
    for (int i = 0; i < 260; ++i)
      for (int j = 0; j < 260; ++j) points += fmt::format("{},{},0\n", 20 + 2 * i, 20 + 2 * j);
    points += "0,5000,0\n";
    write_file(folder() / "far.csv", points);
  }
  void write_far(const std::string& key) const {
    write("sensors: {mast: {at: [1, -4, 4], noise: {range: 0.005}" + key + "}}\n" +
          "scans:\n  - {sensor: mast, file: floor.csv, time: 4.8, frame: world}\n"
          "  - {sensor: mast, file: far.csv, time: 4.9, frame: world}\n");
  }
};

TEST_F(FarScanRun, LeavesOutWhatIsBeyondTheSensorsRange) {
  write_far("");
  EXPECT_NE(run("run dig.yaml").err.find("it must be within 1000 m"), std::string::npos);
  write_far(", max_range: 15");
  EXPECT_EQ(good("run dig.yaml").err, "");
  const nlohmann::json far = summary();
  write(kScans);  // the same without these points
  fs::remove_all(out());
  good("run dig.yaml");
  EXPECT_EQ(summary()["state_hash"], far["state_hash"]);
  EXPECT_EQ(summary()["volume_m3"], far["volume_m3"]);
}

TEST_F(FarScanRun, GoesOnWithASmallerRangeWhereScansSawTooMuch) {
  write_far(", max_range: 1000");
  const Result failed = run("run dig.yaml");
  EXPECT_EQ(failed.status, 1);
  EXPECT_NE(failed.err.find("far.csv: scan at 4.9 s: scans may see 65536 squares of 8 x 8 voxels"),
            std::string::npos)
      << failed.err;
  EXPECT_NE(failed.err.find("give the sensor a max_range"), std::string::npos) << failed.err;
  EXPECT_NE(failed.err.find("once that is mended `soilvdb resume out/dig` goes on from 4.8 s"),
            std::string::npos)
      << failed.err;
  EXPECT_EQ(run("resume out/dig").status, 1) << "it is not mended";
  write_far(", max_range: 15, mount: {height: 0.02}");
  const Result other = run("resume out/dig");
  EXPECT_EQ(other.status, 2);
  EXPECT_NE(other.err.find("has changed since the run"), std::string::npos) << other.err;
  write_far(", max_range: 15");
  good("resume out/dig");
  const nlohmann::json mended = summary();
  fs::remove_all(out());
  good("run dig.yaml");
  EXPECT_EQ(summary()["state_hash"], mended["state_hash"]);
  EXPECT_EQ(summary()["machines"], mended["machines"]);
}

TEST_F(ScanRun, RefusesARangeThatNoSensorHas) {
  for (const char* range : {"0", "-1", "1000.1"})
    expect_refused_line(fmt::format("sensors:\n  mast:\n    at: [1, -4, 4]\n    max_range: {}\n"
                                    "scans: [{{sensor: mast, file: floor.csv, time: 4.8}}]\n",
                                    range),
                        fmt::format("dig.yaml:11: sensor 'mast': max_range is {}; it must be more "
                                    "than 0 and at most 1000",
                                    range));
}

TEST_F(ScanRun, OfAnotherClockAreWarnedOf) {  // the motion is from 0 to 5 s
  const auto told = [&](double time_s) {
    write(
        fmt::format("sensors: {{mast: {{at: [1, -4, 4], noise: {{range: 0.005}}}}}}\n"
                    "scans: [{{sensor: mast, file: floor.csv, time: {}, frame: world}}]\n",
                    time_s));
    return run("info dig.yaml").out;
  };
  const std::string words =
      "all motions, which are from 0 to 5 s; its time must be by the same clock";
  for (const double time_s : {-600.0, 2.0, 605.0}) EXPECT_EQ(told(time_s).find(words), words.npos);
  EXPECT_NE(told(-601).find("dig.yaml:9: the scan is 601 s before " + words), words.npos);
  EXPECT_NE(told(606).find("dig.yaml:9: the scan is 601 s after " + words), words.npos);
}

TEST_F(CarriedScanRun, IsSeenFromWhereItsMachineIsThen) {
  for (const char* updates : {"", " --updates 100", " --updates 7", " --updates 1"}) {
    SCOPED_TRACE(updates);
    good(std::string("run dig.yaml") + updates);
    EXPECT_NEAR(summary()["volume_m3"]["surveyed_removed"].get<double>(), 0.6, 0.06);
    const io::Site site = io::read_snapshot(out() / "soil_final.vdb");
    const std::vector<Vec2> at = {{5.1, 0}, {5.9, 0}, {4.85, 0}, {6.15, 0}};
    std::vector<double> z(at.size());
    HeightMap(*site.ground).at(at, z).check();
    for (std::size_t i = 0; i < at.size(); ++i) EXPECT_NEAR(z[i], i < 2 ? -0.3 : 0, 0.05) << i;
    fs::remove_all(out());
  }
}

TEST_F(RecordedScanRun, AreThinnedByTimeWhateverTheyAreRoundedTo) {
  for (const double begin_s : {0.0, 1.7e9}) {
    io::Recording recording(folder() / "many.mcap");
    for (int i = 0; i < 60; ++i) {
      const double time_s = begin_s + 1 + 0.05 * i;
      recording.message("/camera", "sensor_msgs/msg/PointCloud2",
                        io::CloudMessage{}.cdr(time_s, "c"), time_s);
    }
    recording.close();
    for (const auto& [every, scans] : {std::pair("0.05", 60), {"0.1", 30}, {"0.3", 10}}) {
      write(sensor("at: [0, 0, 3], ") +
            fmt::format("scans: [{{sensor: mast, mcap: many.mcap, topic: /camera, every: {}}}]\n",
                        every));
      const io::Scenario read = io::read_scenario(folder() / "dig.yaml");
      EXPECT_EQ(read.scans.size(), static_cast<std::size_t>(scans)) << every << " " << begin_s;
      const bool told =
          !read.warnings.empty() &&
          read.warnings.back().find("before or after all motions") != std::string::npos;
      EXPECT_EQ(told, begin_s > 0);
    }
  }
}

TEST_F(ScanRun, TellsOfRaysThatDoNotFitTheGround) {
  std::string points = "x,y,z\n";
  for (int i = 0; i < 400; ++i)
    points += fmt::format("{},{},1\n", -1 - 0.1 * (i % 20), 0.1 * (i / 20));
  write_file(folder() / "above.csv", points);
  write(
      "sensors: {mast: {at: [1, -4, 4], noise: {range: 0.005}}}\n"
      "scans: [{sensor: mast, file: above.csv, time: 4.8, frame: world}]\n");
  const std::string told = good("run dig.yaml").err;
  EXPECT_NE(told.find("100 % of the rays do not meet the ground where it is expected"), told.npos)
      << told;
  fs::remove_all(out());
  write(kScans);
  EXPECT_EQ(good("run dig.yaml").err.find("% of the rays"), told.npos);
  fs::remove_all(out());
  expect_refused_line(
      "sensors: {mast: {noise: {range: 0.005}}}\n"
      "scans: [{sensor: mast, file: floor.csv, time: 4.8}]\n",
      "sensor 'mast' has no place");
}

TEST_F(RecordedScanRun, RefusesWhatIsNoRecordingOfScans) {
  const auto refused = [&](const std::string& scan, const std::string& words) {
    expect_refused_line(sensor("") + "scans: [{sensor: mast, " + scan + "}]\n", words);
  };
  refused("mcap: drive.mcap, topic: /lidar", "topic '/lidar'");
  refused("mcap: none.mcap, topic: /lidar/points", "none.mcap");
  refused("mcap: drive.mcap, topic: /lidar/points, time: 3", "'time' does not go with 'mcap'");
  refused("file: floor.csv, time: 3, topic: /lidar/points", "'topic' goes with 'mcap'");
  refused("mcap: drive.mcap, topic: /lidar/points, parent: odom", "odom");
  expect_refused_line(sensor("at: [0, 0, 4], ") +
                          "scans: [{sensor: mast, mcap: drive.mcap, topic: /lidar/points, parent: "
                          "map}]\n",
                      "remove 'parent'");
  io::Recording still(folder() / "still.mcap");
  still.message("/lidar/points", "sensor_msgs/msg/PointCloud2", io::CloudMessage{}.cdr(1, "lidar"),
                1);
  still.close();
  refused("mcap: still.mcap, topic: /lidar/points", "where frame 'lidar' is at the time of 1 scan");
}

}  // namespace scan_run_test
}  // namespace soilvdb::test
