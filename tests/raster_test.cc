// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/raster.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <thread>

#include "io/file/atomic_file.h"
#include "io/terrain/crs.h"
#include "soilvdb/tracker.h"
#include "tests/temp_folder.h"

extern "C" int GDALGetDriverCount();
extern "C" void GDALAllRegister();

namespace soilvdb::io {
namespace {

using test::TempFolder;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
constexpr const char* kUtm17 =
    "PROJCS[\"WGS 84 / UTM zone 17N\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\","
    "6378137,298.257223563]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],"
    "PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],"
    "PARAMETER[\"central_meridian\",-81],PARAMETER[\"scale_factor\",0.9996],"
    "PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\",0],UNIT[\"metre\",1],"
    "AUTHORITY[\"EPSG\",\"32617\"]]";
constexpr const char* kDegrees =
    "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
    "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]";

std::string with_unit(std::string wkt, const std::string& from, const std::string& to) {
  const auto at = wkt.rfind(from);
  return wkt.replace(at, from.size(), to);
}

/// An Esri ASCII grid of 3 x 2 cells of 2 m at (100, 200).
std::string ascii(const std::string& values, const std::string& more = "") {
  return "ncols 3\nnrows 2\nxllcorner 100\nyllcorner 200\ncellsize 2\n" + more + values;
}

std::vector<float> all_of(const RasterInput& raster) {
  std::vector<float> out(std::size_t(raster.grid.nx) * raster.grid.ny);
  raster.source->read(0, 0, raster.grid.nx, raster.grid.ny, out.data());
  return out;
}

void expect_same(const std::vector<float>& a, const std::vector<float>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (std::isnan(a[i]) && std::isnan(b[i])) continue;
    EXPECT_EQ(a[i], b[i]) << "post " << i;
  }
}

std::string refusal(const TempFolder& folder, const std::filesystem::path& file) {
  try {
    open_raster(file);
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), Not(HasSubstr("\n")));
    return test::message_of(folder, [&] { throw e; });
  }
  return "accepted";
}

std::filesystem::path shared(const std::string& name) {
  const char* folder = std::getenv("SOILVDB_SHARED");
  return (folder != nullptr ? std::filesystem::path(folder)
                            : std::filesystem::path(SOILVDB_SOURCE_DIR) / ".." / "shared") /
         "data" / name;
}

#define SKIP_UNLESS_THERE(file) \
  if (!std::filesystem::exists(file)) GTEST_SKIP() << (file) << " is not there"

/// What a shell command prints; nothing if it fails.
std::string output_of(const std::string& command) {
  std::FILE* pipe = ::popen((command + " 2>/dev/null").c_str(), "r");
  std::string text;
  char buffer[4096];
  for (std::size_t n; (n = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) text.append(buffer, n);
  return ::pclose(pipe) == 0 ? text : "";
}

HeightGrid grid_of(int nx, int ny, Vec2 first, Vec2 spacing) { return {nx, ny, first, spacing}; }

// ---- reading

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

// ---- refusals

TEST(Raster, DegreesAreRefusedWithTheCommandThatReprojects) {
  const TempFolder folder;
  const auto file = folder.write(
      "a.asc", "ncols 2\nnrows 2\nxllcorner -77\nyllcorner 38\ncellsize 0.1\n1 2\n3 4\n");
  folder.write("a.prj", kDegrees);
  EXPECT_THAT(refusal(folder, file), HasSubstr("is in degrees"));
  EXPECT_THAT(refusal(folder, file), HasSubstr("gdalwarp -t_srs EPSG:32618 -novshift -r bilinear "
                                               "-ot Float32 -dstnodata -9999 a.asc a_utm.tif"));
}

TEST(Raster, TheUtmZoneIsThatOfThePlace) {
  EXPECT_EQ(utm_epsg(-180, 10), 32601);
  EXPECT_EQ(utm_epsg(179.99, 10), 32660);
  EXPECT_EQ(utm_epsg(180, 10), 32601);
  EXPECT_EQ(utm_epsg(9, 48), 32632);
  EXPECT_EQ(utm_epsg(18.4, -33.9), 32734);
  EXPECT_EQ(utm_epsg(283, 38), 32618);
  EXPECT_EQ(utm_epsg(0, 85), 32661);
  EXPECT_EQ(utm_epsg(0, -85), 32761);
}

TEST(Raster, FeetAreRefusedWithTheCommandThatReprojects) {
  const TempFolder folder;
  const auto file = folder.write("a.asc", ascii("4 5 6\n1 2 3\n"));
  folder.write("a.prj",
               with_unit(with_unit(kUtm17, ",AUTHORITY[\"EPSG\",\"32617\"]", ""),
                         "UNIT[\"metre\",1]", "UNIT[\"US survey foot\",0.3048006096012192]"));
  EXPECT_THAT(refusal(folder, file), HasSubstr("'US survey foot', not metres"));
  EXPECT_THAT(refusal(folder, file), HasSubstr("gdalwarp -t_srs EPSG:326"));
  EXPECT_THAT(refusal(folder, file),
              HasSubstr("; that leaves heights as they are; if they are in the same unit, convert "
                        "them, too, with: gdal_calc.py --calc=A*0.304800609"));
}

/// A map in metres whose metres aren't, at a latitude in degrees.
std::string mercator(const TempFolder& folder, double latitude) {
  constexpr double kRadius_m = 6378137;
  const double north_m =
      kRadius_m * std::atanh(std::sin(latitude * std::numbers::pi / 180));  // of a sphere
  folder.write("a.prj",
               R"(PROJCS["WGS 84 / Pseudo-Mercator",GEOGCS["WGS 84",DATUM["WGS_1984",)"
               R"(SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],)"
               R"(UNIT["degree",0.0174532925199433]],PROJECTION["Mercator_1SP"],)"
               R"(PARAMETER["central_meridian",0],PARAMETER["scale_factor",1],)"
               R"(PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1],)"
               R"(EXTENSION["PROJ4","+proj=merc +a=6378137 +b=6378137 +lat_ts=0 +lon_0=0 +x_0=0 )"
               R"(+y_0=0 +k=1 +units=m +nadgrids=@null +wktext +no_defs"],)"
               R"(AUTHORITY["EPSG","3857"]])");
  return refusal(folder,
                 folder.write("a.asc", fmt::format("ncols 3\nnrows 2\nxllcorner 1000000\n"
                                                   "yllcorner {}\ncellsize 1\n4 5 6\n1 2 3\n",
                                                   north_m)));
}

TEST(Raster, WebMercatorIsRefusedWhereItsMetresAreNone) {
  const TempFolder folder;
  // cos(latitude) times the ellipsoid's mean radius there over that at the equator: 0.5 x 1.00168
  // at 60 degrees, 0.70711 x 0.99999 at 45.
  EXPECT_THAT(mercator(folder, 60),
              HasSubstr("'WGS 84 / Pseudo-Mercator', of which 1 m is 0.5008 m on the ground here"));
  EXPECT_THAT(
      mercator(folder, 45),
      HasSubstr("of which 1 m is 0.7071 m on the ground here; reproject it with: gdalwarp "
                "-t_srs EPSG:32632 -novshift -r bilinear -ot Float32 -dstnodata -9999 a.asc "
                "a_utm.tif"));
  EXPECT_EQ(mercator(folder, 1), "accepted") << "off by less than a percent";
}

TEST(Raster, WhatIsAdvisedAtThePolesIsAcceptedThere) {
  const TempFolder folder;
  folder.write("a.asc",
               "ncols 3\nnrows 2\nxllcorner 2000000\nyllcorner 2000000\ncellsize 1\n"
               "4 5 6\n1 2 3\n");
  ASSERT_EQ(std::system(fmt::format("cd '{}' && gdal_translate -q -a_srs EPSG:32761 a.asc a.tif",
                                    folder.path().string())
                            .c_str()),
            0);
  EXPECT_EQ(refusal(folder, folder / "a.tif"), "accepted");
}

TEST(Raster, DegreesWithoutACrsAreRecognised) {
  const TempFolder folder;
  const std::string header = "ncols 3\nnrows 2\nxllcorner -77\nyllcorner 38\ncellsize 0.0003\n";
  EXPECT_THAT(refusal(folder, folder.write("a.asc", header + "40 50 60\n10 20 30\n")),
              HasSubstr("gdalwarp -s_srs EPSG:4326 -t_srs EPSG:32618"));
  // A tray of sand, scanned at 0.3 mm, is as small but flatter than wide.
  EXPECT_EQ(refusal(folder, folder.write("b.asc", header + "1e-4 0 0\n0 0 1e-4\n")), "accepted");
}

TEST(Raster, ARotatedRasterIsRefused) {
  const TempFolder folder;
  folder.write("a.img", std::string(6 * 4, '\0'));
  folder.write("a.hdr",
               "ENVI\nsamples = 3\nlines = 2\nbands = 1\nheader offset = 0\n"
               "data type = 4\ninterleave = bsq\nbyte order = 0\n"
               "map info = {Arbitrary, 1, 1, 100, 204, 2, 2, units=Meters, rotation=30}\n");
  EXPECT_THAT(refusal(folder, folder / "a.img"),
              HasSubstr("is rotated; turn it north up with: gdalwarp -r bilinear -ot Float32 "
                        "-dstnodata -9999 a.img a_north_up.tif"));
}

/// Does what a message advises, in the folder. @return did that work?
bool follow(const TempFolder& folder, const std::string& message, const std::string& from) {
  std::string command = message.substr(message.find(from));
  command = command.substr(0, command.find(" (its heights"));
  return !output_of("cd " + folder.path().string() + " && " + command + " && echo done").empty();
}

TEST(Raster, WhatIsAdvisedForARotatedOneLeavesNoGroundOutsideOfIt) {
  if (output_of("command -v gdalwarp").empty()) GTEST_SKIP() << "gdalwarp is not there";
  const TempFolder folder;
  constexpr int kSide = 20;
  std::string bytes;
  for (int i = 0; i < kSide * kSide; ++i) bytes += std::string("\xc4\x09", 2);  // 2500, no NODATA
  folder.write("a.img", bytes);
  folder.write("a.hdr",
               "ENVI\nsamples = 20\nlines = 20\nbands = 1\nheader offset = 0\n"
               "data type = 12\ninterleave = bsq\nbyte order = 0\n"
               "map info = {Arbitrary, 1, 1, 100, 204, 2, 2, units=Meters, rotation=30}\n");
  ASSERT_TRUE(follow(folder, refusal(folder, folder / "a.img"), "gdalwarp"));
  int ground = 0, none = 0;
  for (const float z : all_of(open_raster(folder / "a_north_up.tif"))) {
    (std::isnan(z) ? none : ground)++;
    if (!std::isnan(z)) {
      EXPECT_EQ(z, 2500);
    }
  }
  EXPECT_GT(ground, kSide * kSide / 2);
  EXPECT_GT(none, kSide);  // the corners
}

TEST(Raster, WhatIsAdvisedForDegreesTakesHeightsInFeetToMetres) {
  if (output_of("command -v gdalwarp && command -v gdal_calc.py").empty())
    GTEST_SKIP() << "gdalwarp or gdal_calc.py is not there";
  const TempFolder folder;
  folder.write("a.asc",
               "ncols 3\nnrows 3\nxllcorner -77\nyllcorner 38\ncellsize 0.001\n"
               "1000.5 1000.5 1000.5\n1000.5 1000.5 1000.5\n1000.5 1000.5 1000.5\n");
  ASSERT_FALSE(output_of("cd " + folder.path().string() +
                         " && gdal_translate -a_srs EPSG:4326+6360 a.asc a.tif")
                   .empty());
  const std::string message = refusal(folder, folder / "a.tif");
  EXPECT_THAT(message, HasSubstr("(its heights are in 'US survey foot', which gdalwarp leaves"));
  ASSERT_TRUE(follow(folder, message, "gdalwarp")) << message;
  int ground = 0;
  for (const float z : all_of(open_raster(folder / "a_utm_m.tif"))) {
    if (std::isnan(z)) continue;
    ++ground;
    EXPECT_FLOAT_EQ(z, 1000.5F * 1200 / 3937);
  }
  EXPECT_GT(ground, 4);
}

TEST(Raster, ARowOfGigabytesIsRefusedUnread) {
  const TempFolder folder;
  std::ifstream in(SOILVDB_SOURCE_DIR "/tests/fuzz/regressions/raster/row_of_6_GB",
                   std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(in), {});
  ASSERT_FALSE(bytes.empty());
  EXPECT_EQ(refusal(folder, folder.write("a.grd", bytes.substr(1))),
            "a.grd: is damaged or has too large blocks, 761754371 x 1 cells, of which each is read "
            "whole; tiles, as of gdal_translate -co TILED=YES, would do");
}

TEST(Raster, WhatIsNoRasterIsRefusedInOneLine) {
  const TempFolder folder;
  EXPECT_THAT(refusal(folder, folder / "none.tif"), HasSubstr("no such file"));
  EXPECT_THAT(refusal(folder, folder.path()), HasSubstr("is a folder"));
  EXPECT_THAT(refusal(folder, folder.write("empty.tif", "")), HasSubstr("is not a raster"));
  EXPECT_THAT(refusal(folder, folder.write("text.tif", "hello")), HasSubstr("is not a raster"));
  EXPECT_THAT(
      refusal(folder, folder.write("void.asc", ascii("-9999 -9999 -9999\n-9999 -9999 -9999"))),
      HasSubstr("has no height"));
  EXPECT_THAT(refusal(folder, folder.write("one.asc",
                                           "ncols 1\nnrows 1\nxllcorner 0\nyllcorner 0\n"
                                           "cellsize 1\n5\n")),
              HasSubstr("1 x 1 cells"));
}

TEST(Raster, FormatsThatReferToOtherFilesAreNotFollowed) {
  const TempFolder folder;
  folder.write("a.asc", ascii("4 5 6\n1 2 3\n"));
  const auto vrt = folder.write(
      "a.vrt",
      "<VRTDataset rasterXSize=\"3\" rasterYSize=\"2\"><GeoTransform>100,2,0,204,0,-2"
      "</GeoTransform><VRTRasterBand dataType=\"Float32\" band=\"1\"><SimpleSource>"
      "<SourceFilename relativeToVRT=\"1\">a.asc</SourceFilename><SourceBand>1</SourceBand>"
      "</SimpleSource></VRTRasterBand></VRTDataset>");
  EXPECT_THAT(refusal(folder, vrt), HasSubstr("is not a raster that is read as terrain"));
  EXPECT_THAT(refusal(folder, vrt), HasSubstr("gdal_translate"));
}

TEST(Raster, FormatsThatHoldNoHeightsAreUnknownToGdalHere) {
  const TempFolder folder;
  refusal(folder, folder.write("empty.tif", ""));
  EXPECT_EQ(GDALGetDriverCount(), 14) << "as many as io/terrain/gdal.cc names";
  // Whoever links us may use all that GDAL has; we still don't.
  GDALAllRegister();
  folder.write("a.asc", ascii("4 5 6\n1 2 3\n"));
  ASSERT_EQ(std::system(fmt::format("gdal_translate -q -of PNG -ot UInt16 '{0}/a.asc' '{0}/a.png'",
                                    folder.path().string())
                            .c_str()),
            0);
  EXPECT_THAT(refusal(folder, folder / "a.png"),
              HasSubstr("is not a raster that is read as terrain"));
}

TEST(Raster, ACutOffRasterIsRefusedAtOpening) {
  const TempFolder folder;
  EXPECT_THAT(refusal(folder, folder.write("a.asc", ascii("4 5 6\n1\n"))), HasSubstr("is damaged"));
  std::vector<float> values(3000 * 1000);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i * i % 1013);
  write_geotiff(folder / "a.tif", grid_of(3000, 1000, {0, 0}, {1, 1}), {{"z", values}}, "");
  ASSERT_EQ(refusal(folder, folder / "a.tif"), "accepted");
  const auto size = std::filesystem::file_size(folder / "a.tif");
  for (const double share : {0.05, 0.5, 0.9, 0.999}) {
    std::filesystem::copy_file(folder / "a.tif", folder / "b.tif",
                               std::filesystem::copy_options::overwrite_existing);
    std::filesystem::resize_file(folder / "b.tif",
                                 static_cast<std::uintmax_t>(share * double(size)));
    EXPECT_THAT(refusal(folder, folder / "b.tif"), HasSubstr("b.tif: is damaged")) << share;
  }
}

TEST(Raster, DamageThatShowsLateNamesTheFile) {
  const TempFolder folder;
  std::vector<float> values(3000 * 1000);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i * i % 1013);
  write_geotiff(folder / "a.tif", grid_of(3000, 1000, {0, 0}, {1, 1}), {{"z", values}}, "");
  {
    std::fstream file(folder / "a.tif", std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(static_cast<std::streamoff>(std::filesystem::file_size(folder / "a.tif") * 3 / 10));
    file << std::string(3000, 'x');
  }
  std::shared_ptr<const HeightSource> source;
  try {
    source = open_raster(folder / "a.tif").source;
  } catch (const InputError&) {
    GTEST_SKIP() << "seen at opening already";
  }
  EXPECT_THAT(test::message_of(folder, [&] { source->read(0, 0, 3000, 1000, values.data()); }),
              HasSubstr("a.tif: is damaged: rows"));
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
  const auto begin = std::chrono::steady_clock::now();
  const RasterInput raster = open_raster(folder / "a.img");
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  EXPECT_EQ(raster.grid.nx, 20'000);
  EXPECT_LT(took.count(), 0.5);  // the project's bound for opening a site
  const auto ground = make_height_field(raster.grid, raster.source);
  for (const double x : {150.0, 20'000.0, 40'000.0}) EXPECT_EQ(ground->height(x, -20'000), 0);
  if (before < 0) GTEST_SKIP() << "no /proc";
  // A look at nine posts and three windows of 128 x 128, each by whole rows of the file.
  EXPECT_LT(bytes_read() - before, (9 + 3 * 128) * 20'000 * 4 + 1'000'000);
}

TEST(Raster, GdalPrintsNothing) {
  const TempFolder folder;
  ::testing::internal::CaptureStderr();
  refusal(folder, folder.write("a.tif", std::string("II*\0\x08\0\0\0\xff\xff garbage", 18)));
  refusal(folder, folder.write("a.asc", ascii("4 5 6\n1 x\n")));
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
}

// ---- real files

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

TEST(Raster, RealDamagedFilesAreRefused) {
  SKIP_UNLESS_THERE(shared("malformed/corrupt1.tif"));
  const TempFolder folder;
  ::testing::internal::CaptureStderr();
  EXPECT_THAT(refusal(folder, shared("malformed/corrupt1.tif")), HasSubstr("corrupt1.tif: "));
  EXPECT_THAT(refusal(folder, shared("malformed/crash-1633.tif")), HasSubstr("crash-1633.tif: "));
  EXPECT_THAT(refusal(folder, shared("malformed/sphere.vdb")), HasSubstr("is not a raster"));
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
}

TEST(Raster, ForeignFeetOfHeightAreRefusedAndTheCommandHelps) {
  SKIP_UNLESS_THERE(shared("dem/dtm.tif"));
  const TempFolder folder;
  if (output_of("gdal_translate -a_srs EPSG:26918+6360 " + shared("dem/dtm.tif").string() + " " +
                (folder / "a.tif").string())
          .empty()) {
    GTEST_SKIP() << "gdal_translate is not there";
  }
  const std::string message = refusal(folder, folder / "a.tif");
  EXPECT_THAT(message, HasSubstr("heights are in 'US survey foot'"));
  const auto command = message.find("gdal_calc.py");
  ASSERT_NE(command, message.npos);
  if (output_of("command -v gdal_calc.py").empty()) GTEST_SKIP() << "gdal_calc.py is not there";
  output_of("cd " + folder.path().string() + " && " + message.substr(command));
  EXPECT_EQ(refusal(folder, folder / "a_m.tif"), "accepted");
}

// ---- writing

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

TEST(Rasterise, CellsLieAtMultiplesOfTheirSizeAndHoldTheSurfaceAndItsChange) {
  const Soil soil(0.1, {0, 0, 0}, make_plane(1, {0.5, -0.25}));
  const SurfaceRaster raster = rasterise(soil, {Vec2(0.3, -0.9), Vec2(2.2, 0.4)}, 0.5);
  EXPECT_EQ(raster.grid.nx, 5);
  EXPECT_EQ(raster.grid.ny, 3);
  EXPECT_EQ(raster.grid.first, Vec2(0.25, -0.75));
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 5; ++i) {
      const double z = 1 + 0.5 * (0.25 + 0.5 * i) - 0.25 * (-0.75 + 0.5 * j);
      EXPECT_EQ(raster.change[j * 5 + i], 0);
      EXPECT_FLOAT_EQ(raster.surface[j * 5 + i], float(z));
    }
  }
  EXPECT_THROW(rasterise(soil, {Vec2(0, 0), Vec2(1, 1)}, 1e-6), std::invalid_argument);
  EXPECT_THROW(rasterise(soil, {Vec2(0, 0), Vec2(1, 1)}, 0), std::invalid_argument);
}

TEST(SurfaceRaster, ItsVolumeIsTheLedgers) {
  for (const double yaw : {0.0, 0.3, 0.9}) {
    for (const double h : {0.05, 0.1}) {
      Soil soil(h, Vec3(400000, 5000000, 100), make_plane(100.013, {0, 0}));
      Bucket bucket;
      bucket.width_m = 0.6;
      bucket.height_m = 1;
      Tracker tracker(soil, {bucket});
      for (int i = 0; i <= 50; ++i) {
        const double s = i / 50.0, x = 2 * s * std::cos(yaw), y = 2 * s * std::sin(yaw);
        tracker.update(
            0, {{400000.2 + x, 5000000.1 + y, 100 - 0.3 * std::sin(3 * s)}, from_rpy(0, 0, yaw)});
      }
      const double cut_m3 = tracker.total().cut_m3();
      // Cells that are a multiple of the voxels, and others.
      for (const double cell_m : {h, 2 * h, 0.25, 0.37}) {
        const SurfaceRaster raster =
            rasterise(soil, {Vec2(399998, 4999998), Vec2(400004, 5000004)}, cell_m);
        double sum = 0;
        for (std::size_t i = 0; i < raster.change.size(); ++i) {
          sum += double{raster.change[i]};
          EXPECT_NEAR(raster.surface[i], raster.base[i] + raster.change[i], 1e-5);
        }
        EXPECT_NEAR(-sum * cell_m * cell_m, cut_m3, 1e-6 * cut_m3) << yaw << " " << cell_m;
      }
    }
  }
}

class Level final : public HeightSource {
  void read(int, int, int nx, int ny, float* out) const override { std::fill_n(out, nx * ny, 7); }
};

double volume_m3(const SurfaceRaster& raster, const std::vector<float>& change) {
  double sum = 0;
  for (const float rise : change) sum += std::isnan(rise) ? 0 : double{rise};
  return sum * raster.grid.spacing.prod();
}

void drag(Soil& soil, double width_m, const Vec3& from, double length_m) {
  Bucket bucket;
  bucket.width_m = width_m;
  bucket.height_m = 1;
  Tracker tracker(soil, {bucket});
  for (const double s : {0.0, length_m})
    tracker.update(0, {from + Vec3(s, 0, 0), Eigen::Quaterniond::Identity()});
}

TEST(SurfaceRaster, HoldsAllThatWasDugAtTheEdgeOfTheTerrain) {
  // Posts from 0.25 to 4.25: a trench along the first, and one into a corner. Cells begin at 0.
  const std::shared_ptr<const BaseSurface> ground =
      make_height_field(grid_of(9, 9, {0.25, 0.25}, {0.5, 0.5}), std::make_shared<Level>());
  const Soil before(0.05, Vec3::Zero(), ground);
  constexpr double kInside = 0.4001, kLength = 1.249;
  for (const Vec3& from : {Vec3(1.013, 0.25 + kInside, 6.61), Vec3(3, 4.25 - kInside, 6.61)}) {
    const double m3 = 0.8 * kLength * 0.39;
    Soil after(0.05, Vec3::Zero(), ground), fine(0.025, Vec3::Zero(), ground);
    drag(after, 0.8, from, kLength);
    drag(fine, 0.8, from, kLength);
    EXPECT_NEAR(-after.change_m3(), m3, 2e-3 * m3);
    for (const double cell_m : {0.05, 0.07, 0.3, 1.0}) {
      const SurfaceRaster raster = rasterise(after, {Vec2(-1, -1), Vec2(6, 6)}, cell_m);
      EXPECT_NEAR(volume_m3(raster, raster.change), after.change_m3(), 1e-6 * m3) << cell_m;
      EXPECT_NEAR(volume_m3(raster, rasterise_change(before, after, true, raster)),
                  after.change_m3(), 1e-6 * m3);
      EXPECT_NEAR(volume_m3(raster, rasterise_change(before, fine, true, raster)), fine.change_m3(),
                  1e-6 * m3);
      EXPECT_TRUE(std::isnan(raster.change[0])) << "neither ground nor a change";
      EXPECT_TRUE(std::isnan(raster.surface[0]));
    }
  }
}

TEST(SurfaceRaster, ChangeIsSinceTheGroundBeforeAnyoneDug) {
  const std::shared_ptr<const BaseSurface> ground = make_plane(0.013, {0, 0});
  auto first = std::make_shared<Soil>(0.05, Vec3::Zero(), ground);
  drag(*first, 0.8, {0.113, 0.027, -0.287}, 2);
  // The same digging goes on in the ground itself, and in one with other voxels made from it.
  Soil other(0.025, Vec3::Zero(), make_soil_surface(first));
  drag(other, 0.8, {1.013, 0.027, -0.487}, 2);
  const double before_m3 = first->change_m3(), after_m3 = before_m3 + other.change_m3();
  EXPECT_NEAR(after_m3, -0.8 * (0.9 * 0.3 + 2 * 0.5), 3e-3);
  const SurfaceRaster raster = rasterise(other, {Vec2(-1, -1), Vec2(4, 1)}, 0.05);
  EXPECT_NEAR(volume_m3(raster, raster.change), after_m3, 1e-5);
  drag(*first, 0.8, {1.013, 0.027, -0.487}, 2);
  const SurfaceRaster same = rasterise(*first, {Vec2(-1, -1), Vec2(4, 1)}, 0.05);
  EXPECT_NEAR(volume_m3(same, same.change), -0.8 * (0.9 * 0.3 + 2 * 0.5), 3e-3);
}

}  // namespace
}  // namespace soilvdb::io
