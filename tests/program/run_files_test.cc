// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The commands that look at the files a run left: export, diff, info.
#include <openvdb/openvdb.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <numeric>

#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "tests/program/cli_fixture.h"
#include "tests/support/spheres.h"

namespace soilvdb::test {
namespace run_files_test {

/// A dig with snapshots at 1 s, 2 s, ... 5 s, and what is made of them.
class AfterARun : public CommandLine {
 protected:
  void SetUp() override {
    CommandLine::SetUp();
    write_file(folder() / "dig.yaml",
               half_sine_scenario("{plane: {z: 0}}", "dig.csv", "{snapshots: {every: 1}}"));
    ASSERT_EQ(run("run dig.yaml --out o").status, 0);
  }
  Result good(const std::string& arguments) const {
    const Result result = run(arguments);
    EXPECT_EQ(result.status, 0) << arguments << ": " << result.err;
    EXPECT_EQ(result.err, "") << arguments;
    return result;
  }
};

TEST_F(AfterARun, ExportsEveryFormat) {
  for (const char* suffix : {"ply", "obj", "stl", "glb", "tif", "png", "vdb"}) {
    good(fmt::format("export o/soil_final.vdb --to whole.{}", suffix));
    good(fmt::format("export --region 0.2,-0.5,0.6,0.5 --to part.{} o/soil_final.vdb", suffix));
    EXPECT_GT(fs::file_size(folder() / fmt::format("whole.{}", suffix)), 500u) << suffix;
    EXPECT_GT(fs::file_size(folder() / fmt::format("part.{}", suffix)), 500u) << suffix;
  }
  EXPECT_LT(fs::file_size(folder() / "part.ply"), fs::file_size(folder() / "whole.ply"));
  const std::string png = read_file(folder() / "whole.png");
  EXPECT_EQ(png.substr(1, 3), "PNG");
  EXPECT_EQ(read_file(folder() / "whole.glb").substr(0, 4), "glTF");
  good("export o/soil_final.vdb --to view.png --view perspective");
  EXPECT_NE(read_file(folder() / "view.png"), png);
}

TEST_F(AfterARun, ExportsTheSurfaceThatWasDug) {
  good("export o/soil_final.vdb --to dug.tif");
  const auto raster = io::open_raster(folder() / "dug.tif");
  std::vector<float> heights(static_cast<std::size_t>(raster.grid.nx * raster.grid.ny));
  raster.source->read(0, 0, raster.grid.nx, raster.grid.ny, heights.data());
  const float lowest = *std::min_element(heights.begin(), heights.end());
  EXPECT_NEAR(lowest, -HalfSine::kDepth_m, 0.025);  // to a voxel
}

TEST_F(AfterARun, AnExportedLevelSetIsGroundForOthersAndForUs) {
  good("export o/soil_1.vdb --to closed.vdb --region -1,-1,2,1");
  const Result info = good("info closed.vdb");
  EXPECT_NE(info.out.find("level set"), std::string::npos) << info.out;
  write_file(folder() / "on.yaml", half_sine_scenario("{level_set: closed.vdb}"));
  good("run on.yaml --out on");
  const double cut = read_json(folder() / "on/summary.json")["volume_m3"]["cut"];
  const auto rest = nlohmann::json::parse(good("diff o/soil_1.vdb o/soil_final.vdb --json").out);
  EXPECT_NEAR(cut, rest["cut_m3"], 0.01 * HalfSine::kVolume_m3);
}

TEST_F(AfterARun, AnExportedOccupancyHoldsTheSoilOfItsRegion) {
  openvdb::initialize();
  const auto soil_m3 = [&](const std::string& snapshot, const std::string& to) {
    good(fmt::format("export o/{} --to {} --occupancy --region -1,-1,3,1", snapshot, to));
    openvdb::io::File file((folder() / to).string());
    file.open();
    const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid("occupancy"));
    EXPECT_EQ(grid->getGridClass(), openvdb::GRID_FOG_VOLUME);
    const double h = grid->voxelSize()[0];
    double sum = 0;
    for (auto value = grid->cbeginValueOn(); value; ++value)
      for (const openvdb::Coord& at : value.getBoundingBox())
        if (at.z() * h > -1.2 * HalfSine::kDepth_m) sum += *value;  // below it both reach
    return sum * h * h * h;
  };
  const auto dug = nlohmann::json::parse(good("diff o/soil_1.vdb o/soil_final.vdb --json").out);
  EXPECT_NEAR(soil_m3("soil_1.vdb", "a.vdb") - soil_m3("soil_final.vdb", "b.vdb"), dug["cut_m3"],
              1e-6);
  good("export o/soil_1.vdb --to c.vdb --occupancy --region -1,-1,3,1");
  EXPECT_EQ(read_file(folder() / "a.vdb"), read_file(folder() / "c.vdb"));
}

TEST_F(AfterARun, RefusesExportsThatCannotBe) {
  const std::string from = "export o/soil_final.vdb --to ";
  expect_refused(from + "x.xyz", "suffix");
  expect_refused(from + "x", "suffix");
  expect_refused(from + "o/soil_final.vdb", "input");
  expect_refused(from + "none/x.ply", "none");
  expect_refused(from + "x.ply --region 1,2,3", "four numbers");
  expect_refused(from + "x.ply --region 1,2,3,4,5", "four numbers");
  expect_refused(from + "x.ply --region 1,2,3,nan", "four numbers");
  expect_refused(from + "x.ply --region 1,2,3,", "four numbers");
  expect_refused(from + "x.ply --region 1,0,0,1", "below");
  expect_refused(from + "x.ply --region 100,100,110,110", "misses");
  expect_refused(from + "x.png --view side", "side");
  expect_refused(from + "x.tif --view plan", "x.tif: --view is for pictures");
  expect_refused(from + "x.ply --occupancy", "x.ply: --occupancy is for grids");
  expect_refused(from + "x.png --veiw plan", "no option '--veiw', the nearest is '--view'");
  expect_refused(from + "x.png --veiw=plan", "no option '--veiw', the nearest is '--view'");
  expect_refused(from + "x.png plan", "unexpected word 'plan'");
}

TEST_F(AfterARun, RefusesRegionsInWhichThereIsNothing) {
  const std::string from = "export o/soil_final.vdb --to ";
  // Less than a voxel; and a corner of the resident box, to which no change reaches.
  expect_refused(from + "x.vdb --region 0.5,0.001,0.51,0.011",
                 "0.5,0.001,0.51,0.011: it is too small");
  expect_refused(from + "x.ply --region 0.5,0.001,0.501,0.002", "there is no surface");
  EXPECT_FALSE(fs::exists(folder() / "x.vdb"));
  EXPECT_FALSE(fs::exists(folder() / "x.ply"));
}

TEST_F(AfterARun, AnExportedLevelSetIsTheSameEachTime) {
  for (const char* file : {"a.vdb", "b.vdb"})
    good(fmt::format("export o/soil_final.vdb --to {}", file));
  EXPECT_EQ(read_file(folder() / "a.vdb"), read_file(folder() / "b.vdb"));
  good("export o/soil_1.vdb --to c.vdb");
  EXPECT_NE(read_file(folder() / "a.vdb").substr(21, 36),
            read_file(folder() / "c.vdb").substr(21, 36));
}

TEST_F(CommandLine, ExportsOfWhatLiesBeyondATerrainsHeights) {
  // Posts from 0.05 on along y, where the trench begins.
  std::string heights = "ncols 40\nnrows 16\nxllcorner -1\nyllcorner 0\ncellsize 0.1\n";
  for (int i = 0; i < 40 * 16; ++i) heights += "0 ";
  write_file(folder() / "site.asc", heights + "\n");
  HalfSine edge;
  edge.y_m = 0.05 + HalfSine::kWidth_m / 2 + 1e-4;
  write_file(folder() / "edge.csv", edge.csv(101));
  write_file(folder() / "edge.yaml", half_sine_scenario("{raster: site.asc}", "edge.csv"));
  ASSERT_EQ(run("run edge.yaml --out o").status, 0);
  expect_refused("export o/soil_final.vdb --region 0.4,-0.01,0.6,0.04 --to x.vdb",
                 "--region 0.4,-0.01,0.6,0.04: the terrain has no heights");
}

TEST_F(AfterARun, DiffIsWhatTheLedgerBooked) {
  const auto d = [&](const std::string& a, const std::string& b) {
    return nlohmann::json::parse(good(fmt::format("diff {} {} --json", a, b)).out);
  };
  io::SnapshotInfo one, final;
  io::read_snapshot(folder() / "o/soil_1.vdb", &one);
  io::read_snapshot(folder() / "o/soil_final.vdb", &final);
  const auto forth = d("o/soil_1.vdb", "o/soil_final.vdb");
  EXPECT_NEAR(forth["cut_m3"], final.cut_m3 - one.cut_m3, 1e-12);
  EXPECT_EQ(forth["fill_m3"], 0);
  EXPECT_EQ(forth["net_m3"].get<double>(), -forth["cut_m3"].get<double>());
  // What is left to dig from 1 s on is 4/5 of the length.
  constexpr double kLeft_m2 = 0.8 * HalfSine::kLength_m * HalfSine::kWidth_m;
  EXPECT_NEAR(forth["area_m2"], kLeft_m2, 0.02 * kLeft_m2);
  const auto back = d("o/soil_final.vdb", "o/soil_1.vdb");
  EXPECT_EQ(back["fill_m3"], forth["cut_m3"]);
  EXPECT_EQ(back["cut_m3"], 0);
  EXPECT_EQ(d("o/soil_1.vdb", "o/soil_1.vdb")["area_m2"], 0);
  const auto first = d("o/soil_1.vdb", "o/soil_2.vdb"),
             rest = d("o/soil_2.vdb", "o/soil_final.vdb");
  EXPECT_NEAR(first["cut_m3"].get<double>() + rest["cut_m3"].get<double>(), forth["cut_m3"], 1e-12);
}

TEST_F(AfterARun, DiffWritesARasterAndAPicture) {
  good("diff o/soil_1.vdb o/soil_final.vdb --to d.tif");
  good("diff --to d.png o/soil_1.vdb o/soil_final.vdb");
  good("diff o/soil_1.vdb o/soil_1.vdb --to same.png");
  EXPECT_EQ(read_file(folder() / "d.png").substr(1, 3), "PNG");
  const auto raster = io::open_raster(folder() / "d.tif");
  std::vector<float> change(static_cast<std::size_t>(raster.grid.nx * raster.grid.ny));
  raster.source->read(0, 0, raster.grid.nx, raster.grid.ny, change.data());
  EXPECT_NEAR(*std::min_element(change.begin(), change.end()), -HalfSine::kDepth_m, 0.025);
  EXPECT_LE(*std::max_element(change.begin(), change.end()), 0);
  const double sum = std::accumulate(change.begin(), change.end(), 0.0);
  const auto diff = nlohmann::json::parse(good("diff o/soil_1.vdb o/soil_final.vdb --json").out);
  EXPECT_NEAR(sum * raster.grid.spacing.prod(), -diff["cut_m3"].get<double>(), 1e-7);
  expect_refused("diff o/soil_1.vdb o/soil_final.vdb --to d.ply", "suffix");
  expect_refused("diff o/soil_1.vdb o/soil_final.vdb --to o/soil_1.vdb", "suffix");
}

TEST_F(AfterARun, DiffComparesRunsWithOtherVoxels) {
  good("run dig.yaml --out coarse --voxel 0.05");
  const Result text = good("diff o/soil_final.vdb coarse/soil_final.vdb --to d.png");
  EXPECT_NE(text.out.find("compared in boxes of the larger voxels"), std::string::npos) << text.out;
  const auto d = nlohmann::json::parse(good("diff o/soil_1.vdb coarse/soil_final.vdb --json").out);
  EXPECT_EQ(d["exact"], false);
  const auto same = nlohmann::json::parse(good("diff o/soil_1.vdb o/soil_final.vdb --json").out);
  EXPECT_EQ(same["exact"], true);
  EXPECT_NEAR(d["cut_m3"], same["cut_m3"], d["error_m3"].get<double>());
  // The snapshot as ground for a run with other voxels.
  write_file(folder() / "on.yaml", half_sine_scenario("{level_set: o/soil_1.vdb}"));
  const Result on = run("run on.yaml --out on --voxel 0.05");
  ASSERT_EQ(on.status, 0) << on.err;
  EXPECT_NE(on.err.find("a snapshot with voxels of 0.025 m, true to 0.0125 m"), std::string::npos)
      << on.err;
  EXPECT_NE(good("info on/soil_final.vdb").out.find("true to 0.0125 m"), std::string::npos);
  const auto rest =
      nlohmann::json::parse(good("diff o/soil_final.vdb on/soil_final.vdb --json").out);
  EXPECT_NEAR(rest["cut_m3"], 0, rest["error_m3"].get<double>());
  EXPECT_NEAR(rest["fill_m3"], 0, rest["error_m3"].get<double>());
}

TEST_F(AfterARun, DiffComparesRunsThatBeganFarApart) {
  HalfSine far;
  far.x_m = 2000;  // in another period of the lattice
  write_file(folder() / "far.csv", far.csv(101));
  write_file(folder() / "far.yaml", half_sine_scenario("{plane: {z: 0}}", "far.csv"));
  good("run far.yaml --out far");
  const io::Site here = io::read_snapshot(folder() / "o/soil_final.vdb"),
                 there = io::read_snapshot(folder() / "far/soil_final.vdb");
  EXPECT_NE(here.ground->origin(), there.ground->origin());
  const auto d = nlohmann::json::parse(good("diff o/soil_final.vdb far/soil_final.vdb --json").out);
  EXPECT_EQ(d["exact"], true);
  EXPECT_NEAR(d["fill_m3"], -here.ground->change_m3(), 1e-12);
  EXPECT_NEAR(d["cut_m3"], -there.ground->change_m3(), 1e-12);
}

TEST_F(AfterARun, DiffRefusesTwoSites) {
  write_file(folder() / "low.yaml", half_sine_scenario("{plane: {z: -0.1}}"));
  ASSERT_EQ(run("run low.yaml --out low").status, 0);
  expect_refused("diff o/soil_final.vdb low/soil_final.vdb", "z = -0.1");
}

TEST_F(AfterARun, InfoTellsWhatFilesAre) {
  const std::string snapshot = good("info o/soil_2.vdb").out;
  EXPECT_NE(snapshot.find("snapshot"), std::string::npos);
  EXPECT_NE(snapshot.find("2 s"), std::string::npos);
  const std::string hash = read_json(folder() / "o/summary.json")["state_hash"];
  EXPECT_NE(good("info o/soil_final.vdb").out.find(hash), std::string::npos);
  const std::string scenario = good("info dig.yaml").out;
  EXPECT_NE(scenario.find("101 rows, 5 s"), std::string::npos) << scenario;
  good("export o/soil_final.vdb --to dug.tif");
  const std::string raster = good("info dug.tif").out;
  EXPECT_NE(raster.find("usable"), std::string::npos) << raster;
  EXPECT_NE(raster.find("GTiff"), std::string::npos) << raster;
}

TEST_F(AfterARun, ADamagedSnapshotIsRefused) {
  std::string bytes = read_file(folder() / "o/soil_final.vdb");
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 16);
  write_file(folder() / "damaged.vdb", bytes);
  for (const char* command :
       {"info damaged.vdb", "export damaged.vdb --to x.ply", "diff o/soil_1.vdb damaged.vdb"})
    expect_refused(command, "damaged.vdb");
  write_file(folder() / "cut.vdb", bytes.substr(0, bytes.size() / 3));
  expect_refused("info cut.vdb", "cut.vdb");
}

/// Middles of the triangles of a binary STL, and its origin added.
std::vector<Vec3> middles(const fs::path& file) {
  const std::string bytes = read_file(file);
  std::vector<Vec3> all;
  for (std::size_t at = 84; at + 50 <= bytes.size(); at += 50) {
    float v[12];
    std::memcpy(v, bytes.data() + at, sizeof(v));
    all.emplace_back((v[3] + v[6] + v[9]) / 3.0, (v[4] + v[7] + v[10]) / 3.0,
                     (v[5] + v[8] + v[11]) / 3.0);
  }
  return all;
}
TEST_F(CommandLine, ARegionOfAMeshIsThatOfTheWhole) {
  write_file(folder() / "dig.yaml", half_sine_scenario());
  write_file(folder() / "dig.csv", HalfSine{}.csv(101));
  good("run dig.yaml --out o");
  good("export o/soil_final.vdb --to whole.stl");
  // Just beyond where blocks of 32 voxels of 25 mm meet, and elsewhere.
  for (const std::array<double, 4>& region :
       {std::array{0.2, 0.01, 0.6, 0.09}, {0.81, -0.09, 0.95, 0.09}, {0.3, -0.05, 0.79, -0.01}}) {
    good(fmt::format("export o/soil_final.vdb --to part.stl --region {}", fmt::join(region, ",")));
    const auto inside = [&](const Vec3& p) {
      return p.x() >= region[0] && p.x() < region[2] && p.y() >= region[1] && p.y() < region[3];
    };
    const std::vector<Vec3> whole = middles(folder() / "whole.stl"),
                            part = middles(folder() / "part.stl");
    EXPECT_EQ(std::count_if(whole.begin(), whole.end(), inside),
              static_cast<std::ptrdiff_t>(part.size()))
        << region[0] << ' ' << region[1];
  }
}

TEST_F(CommandLine, DiffRefusesTwoGridsOfOneFile) {
  const auto one = test::level_set_sphere(5, {0, 0, 0}, 0.25f),
             two = test::level_set_sphere(4.9f, {0, 0, 0}, 0.25f);
  one->setName("one");
  two->setName("two");
  openvdb::io::File((folder() / "both.vdb").string()).write(openvdb::GridPtrVec{one, two});
  write_file(folder() / "dig.csv", "time,x,y,z\n0,-0.5,0,4.7\n1,0.5,0,4.7\n");
  for (const char* grid : {"one", "two"}) {
    write_file(folder() / "dig.yaml",
               half_sine_scenario(fmt::format("{{level_set: both.vdb, grid: {}}}", grid)));
    good(fmt::format("run dig.yaml --out {}", grid));
  }
  expect_refused("diff one/soil_final.vdb two/soil_final.vdb", "is not of the same site as");
}

}  // namespace run_files_test
}  // namespace soilvdb::test
