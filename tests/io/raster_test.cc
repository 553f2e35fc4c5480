// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/raster.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <thread>
#include <utility>

#include "io/file/atomic_file.h"
#include "io/terrain/crs.h"
#include "tests/support/raster_fixture.h"
#include "tests/support/sanitized.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace raster_test {

using test::TempFolder;
using ::testing::HasSubstr;

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

void expect_same(const std::vector<float>& a, const std::vector<float>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (std::isnan(a[i]) && std::isnan(b[i])) continue;
    EXPECT_EQ(a[i], b[i]) << "post " << i;
  }
}

TEST(Raster, PostsAreTheCentresOfTheCellsFromTheSouthWestCorner) {
  const TempFolder folder;
  const RasterInput raster = open_raster(folder.write("a.asc", ascii("4 5 6\n1 2 3\n")));
  EXPECT_EQ(raster.driver, "AAIGrid");
  EXPECT_EQ(raster.grid.nx, 3);
  EXPECT_EQ(raster.grid.ny, 2);
  EXPECT_EQ(raster.grid.first, Vec2(101, 201));
  EXPECT_EQ(raster.grid.spacing, Vec2(2, 2));
  EXPECT_EQ(raster.crs_wkt, "");
  expect_same(all_of(raster), {1, 2, 3, 4, 5, 6});
}

TEST(Raster, AWindowHoldsTheSameHeightsAsTheWhole) {
  const TempFolder folder;
  const RasterInput raster = open_raster(folder.write("a.asc", ascii("4 5 6\n1 2 3\n")));
  std::vector<float> window(2);
  raster.source->read(1, 1, 2, 1, window.data());
  expect_same(window, {5, 6});
}

TEST(Raster, ADecimalAfterAHundredKilobytesOfIntegersIsNotCutOff) {
  const TempFolder folder;
  std::string text = "ncols 300\nnrows 300\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
  for (int i = 0; i < 300 * 300 - 1; ++i) text += "17 ";
  const auto heights = all_of(open_raster(folder.write("a.asc", text + "17.75\n")));
  EXPECT_EQ(heights[299], 17.75f);
}

TEST(Raster, DeclaredNodataIsNoHeightEvenIfItIsZero) {
  const TempFolder folder;
  const auto file = folder.write("a.asc", ascii("4 0 6\n1 2 3\n", "NODATA_value 0\n"));
  expect_same(all_of(open_raster(file)), {1, 2, 3, 4, kNone, 6});
}

TEST(Raster, UndeclaredVoidsOfCommonUseAreNoHeight) {
  const TempFolder folder;
  const auto file = folder.write("a.asc", ascii("-9999 -32768 -3.4028235e38\n1 -9998.5 1e6\n"));
  expect_same(all_of(open_raster(file)), {1, -9998.5f, kNone, kNone, kNone, kNone});
  const auto others = folder.write("b.asc", ascii("-99999 -32767 -32766\n1 2 3\n"));
  expect_same(all_of(open_raster(others)), {1, 2, 3, kNone, kNone, -32766});
}

TEST(Raster, RowsMayRunNorthward) {
  const TempFolder folder;
  const float values[6] = {1, 2, 3, 4, 5, 6};
  folder.write("a.img", std::string_view(reinterpret_cast<const char*>(values), sizeof values));
  const auto header = [&](const std::string& dy) {
    folder.write("a.hdr",
                 "ENVI\nsamples = 3\nlines = 2\nbands = 1\nheader offset = 0\n"
                 "data type = 4\ninterleave = bsq\nbyte order = 0\n"
                 "map info = {Arbitrary, 1, 1, 100, 204, 2, " +
                     dy + "}\n");
    return folder / "a.img";
  };
  expect_same(all_of(open_raster(header("2"))), {4, 5, 6, 1, 2, 3});
  EXPECT_EQ(open_raster(header("2")).grid.first, Vec2(101, 201));
  expect_same(all_of(open_raster(header("-2"))), {1, 2, 3, 4, 5, 6});
  EXPECT_EQ(open_raster(header("-2")).grid.first, Vec2(101, 205));
}

/// Both raw formats have headers NAME.hdr, and then take any NAME for theirs.
TEST(Raster, OfOneNameInManyFormatsEachIsReadAsItself) {
  const std::string values = "1 2 3\n4.5 5 6\n";
  for (const auto& [raw, raw_file] : {std::pair{"EHdr", "dem.bil"}, {"ENVI", "dem.dat"}}) {
    const TempFolder folder;
    folder.write("dem.asc", ascii(values));
    std::vector<std::string> files = {"dem.asc"};
    for (const auto& [format, name] : {std::pair{"GTiff", "dem.tif"},
                                       {"HFA", "dem.img"},
                                       {"GSBG", "dem.grd"},
                                       {"SAGA", "dem.sdat"},
                                       {raw, raw_file}}) {
      if (std::system(fmt::format("cd '{}' && gdal_translate -q -ot Float32 -of {} dem.asc {}",
                                  folder.path().string(), format, name)
                          .c_str()) != 0)
        GTEST_SKIP() << "gdal_translate is not there";
      files.emplace_back(name);
    }
    const std::vector<float> truth = all_of(open_raster(folder / "dem.asc"));
    for (const std::string& file : files) {
      const RasterInput raster = open_raster(folder / file);
      EXPECT_EQ(all_of(raster), truth) << file << " beside " << raw;
      EXPECT_EQ(raster.grid.first, Vec2(101, 201)) << file;
    }
  }
}

TEST(Raster, WhatIsWrittenIsReadBackBitForBit) {
  const TempFolder folder;
  const HeightGrid grid = grid_of(301, 277, {400000.25, 5e6}, {0.5, 0.25});
  std::vector<float> values(301 * 277);
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = i % 7 == 0 ? kNone : 500 + 3 * std::sin(0.01f * static_cast<float>(i));
  }
  write_geotiff(folder / "a.tif", grid, {{"surface", values}, {"change", values}}, kUtm17);
  const RasterInput back = open_raster(folder / "a.tif");
  EXPECT_EQ(back.grid.first, grid.first);
  EXPECT_EQ(back.grid.spacing, grid.spacing);
  EXPECT_EQ(crs_label(back.crs_wkt), "EPSG:32617");
  expect_same(all_of(back), values);
}

TEST(Raster, SeveralThreadsReadTheSameHeights) {
  const TempFolder folder;
  const HeightGrid grid = grid_of(600, 600, {0, 0}, {1, 1});
  std::vector<float> values(600 * 600);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i % 1009);
  write_geotiff(folder / "a.tif", grid, {{"z", values}}, "");
  const RasterInput raster = open_raster(folder / "a.tif");
  std::vector<std::vector<float>> out(4);
  std::vector<std::thread> threads;
  for (auto& heights : out) threads.emplace_back([&] { heights = all_of(raster); });
  for (auto& thread : threads) thread.join();
  for (const auto& heights : out) EXPECT_EQ(heights, values);
}

/// Bytes that this process has asked files for.
std::int64_t bytes_read() {
  std::ifstream in("/proc/self/io");
  std::string name;
  std::int64_t value = -1;
  in >> name >> value;  // rchar is the first
  return value;
}

TEST(Raster, OpeningALargeRasterIsQuick) {
  const TempFolder folder;
  // 20 000 x 20 000 floats, sparse on disk: ENVI has no header of its own.
  folder.write("a.img", "");
  std::filesystem::resize_file(folder / "a.img", 20'000ull * 20'000 * 4);
  folder.write("a.hdr",
               "ENVI\nsamples = 20000\nlines = 20000\nbands = 1\nheader offset = 0\n"
               "data type = 4\ninterleave = bsq\nbyte order = 0\n"
               "map info = {Arbitrary, 1, 1, 100, 204, 2, 2}\n");
  const std::int64_t before = bytes_read();
  const std::clock_t begin = std::clock();
  const RasterInput raster = open_raster(folder / "a.img");
  const std::clock_t took = std::clock() - begin;
  EXPECT_EQ(raster.grid.nx, 20'000);
  EXPECT_LT(took, test::cpu_s(0.5));  // the project's bound for opening a site
  const auto terrain = make_height_field(raster.grid, raster.source);
  for (const double x : {150.0, 20'000.0, 40'000.0}) EXPECT_EQ(terrain->height(x, -20'000), 0);
  if (before < 0) GTEST_SKIP() << "no /proc";
  // A look at nine posts and three windows of 128 x 128, each by whole rows of the file.
  EXPECT_LT(bytes_read() - before, (9 + 3 * 128) * 20'000 * 4 + 1'000'000);
}

TEST(Raster, RealTerrainIsRead) {
  SKIP_UNLESS_THERE(shared("dem/dtm.tif"));
  const RasterInput dtm = open_raster(shared("dem/dtm.tif"));
  EXPECT_EQ(crs_label(dtm.crs_wkt), "EPSG:26918");
  EXPECT_EQ(dtm.grid.nx, 283);
  EXPECT_EQ(dtm.grid.ny, 259);
  EXPECT_EQ(dtm.grid.first, Vec2(321499, 4297501));
  const RasterInput reach = open_raster(shared("dem/DEM-kootenai_37x50_1x1.asc"));
  EXPECT_EQ(reach.grid.first, Vec2(556440.5, 5394932.5));
  const auto heights = all_of(reach);
  EXPECT_FLOAT_EQ(heights[36 * 50], 543.340026855468977f);  // the first number of the file
}

TEST(Raster, RealVoidsAreNoHeight) {
  SKIP_UNLESS_THERE(shared("dem/hugo_site_filled.asc"));
  for (const float z : all_of(open_raster(shared("dem/hugo_site_filled.asc")))) {
    EXPECT_TRUE(std::isnan(z) || (z > 1000 && z < 2000)) << z;
  }
  for (const float z : all_of(open_raster(shared("dem/west_bijou_gully.asc")))) {
    EXPECT_TRUE(std::isnan(z) || (z > 1680 && z < 1726)) << z;
  }
}

TEST(Raster, OtherProgramsSeeTheSamePlaceAndCrs) {
  const TempFolder folder;
  write_geotiff(folder / "a.tif", grid_of(3, 2, {400000.25, 5000000.25}, {0.5, 0.5}),
                {{"surface", {1, 2, 3, 4, 5, kNone}}, {"change", {0, 0, 0, 0, 0, 0}}}, kUtm17);
  const std::string text = output_of("gdalinfo -json " + (folder / "a.tif").string());
  if (text.empty()) GTEST_SKIP() << "gdalinfo is not there";
  const auto info = nlohmann::json::parse(text);
  EXPECT_EQ(info["driverShortName"], "GTiff");
  EXPECT_EQ(info["size"], nlohmann::json({3, 2}));
  EXPECT_EQ(info["geoTransform"], nlohmann::json({400000.0, 0.5, 0.0, 5000001.0, 0.0, -0.5}));
  EXPECT_THAT(info["coordinateSystem"]["wkt"].get<std::string>(), HasSubstr("ID[\"EPSG\",32617]"));
  EXPECT_EQ(info["bands"].size(), 2u);
  EXPECT_EQ(info["bands"][0]["description"], "surface");
  EXPECT_EQ(info["bands"][0]["noDataValue"], -9999.0);
  EXPECT_EQ(info["bands"][1]["description"], "change");
}

TEST(Raster, AFileThatCantBeWrittenIsNamedAndNothingIsLeft) {
  const TempFolder folder;
  const HeightGrid grid = grid_of(2, 2, {0, 0}, {1, 1});
  const std::vector<RasterBand> bands{{"z", {1, 2, 3, 4}}};
  EXPECT_THAT(
      test::message_of(folder, [&] { write_geotiff(folder / "no/a.tif", grid, bands, ""); }),
      HasSubstr("no/a.tif: can't be written: No such file"));
  EXPECT_THAT(test::message_of(folder, [&] { write_geotiff("/dev/full", grid, bands, ""); }),
              HasSubstr("/dev/full: can't be written"));
  EXPECT_THAT(test::message_of(folder, [&] { write_geotiff(folder / "a.tif", grid, bands, "x"); }),
              HasSubstr("a.tif: can't be written"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  EXPECT_TRUE(std::filesystem::is_character_file("/dev/full"));
}

TEST(AtomicFile, ReplacesWholeFilesAndKeepsLinks) {
  const TempFolder folder;
  folder.write("a", "old");
  std::filesystem::create_symlink("a", folder / "link");
  write_atomically(folder / "link", "new");
  EXPECT_TRUE(std::filesystem::is_symlink(folder / "link"));
  std::string text;
  std::getline(std::ifstream(folder / "a"), text);
  EXPECT_EQ(text, "new");
  const auto files = std::filesystem::directory_iterator(folder.path());
  EXPECT_EQ(std::distance(begin(files), end(files)), 2);
}

}  // namespace raster_test
}  // namespace soilvdb::io
