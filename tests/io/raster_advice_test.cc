// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rasters in other coordinates than metres north up: refused with the commands that help, which do.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <numbers>
#include <string>

#include "io/terrain/crs.h"
#include "soilvdb/io/raster.h"
#include "tests/support/raster_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace raster_advice_test {

using test::TempFolder;
using ::testing::HasSubstr;

constexpr const char* kDegrees =
    "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
    "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]";

std::string with_unit(std::string wkt, const std::string& from, const std::string& to) {
  const auto at = wkt.rfind(from);
  return wkt.replace(at, from.size(), to);
}

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

TEST(Raster, AMapWhoseMetresAreShorterIsRefusedToo) {
  const test::TempFolder folder;
  folder.write(
      "a.prj",
      R"(PROJCS["half",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",)"
      R"(6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],)"
      R"(PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],)"
      R"(PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.5],)"
      R"(PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1]])");
  const auto file = folder.write("a.asc",
                                 "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 2700000\ncellsize 1\n"
                                 "4 5 6\n1 2 3\n");
  EXPECT_THAT(test::message_of(folder, [&] { io::open_raster(file); }),
              ::testing::HasSubstr("of which 1 m is 2 m on the ground here"));
}

}  // namespace raster_advice_test
}  // namespace soilvdb::io
