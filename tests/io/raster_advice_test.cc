// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rasters in other coordinates than metres north up: refused with the commands that help, which do.
#include <fmt/format.h>
#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <string>
#include <vector>

#include "io/terrain/crs.h"
#include "io/terrain/gdal.h"
#include "soilvdb/io/raster.h"
#include "tests/support/raster_fixture.h"
#include "tests/support/sanitized.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace raster_advice_test {

using test::TempFolder;
using ::testing::HasSubstr;

constexpr const char* kDegrees =
    "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
    "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]";

TEST(Raster, DegreesAreRefusedWithTheCommandThatReprojects) {
  const TempFolder folder;
  const auto file = folder.write(
      "a.asc", "ncols 2\nnrows 2\nxllcorner -77\nyllcorner 38\ncellsize 0.1\n1 2\n3 4\n");
  folder.write("a.prj", kDegrees);
  EXPECT_THAT(refusal(folder, file), HasSubstr("is in degrees"));
  EXPECT_THAT(refusal(folder, file), HasSubstr("gdalwarp -t_srs EPSG:32618 -novshift -r bilinear "
                                               "-ot Float64 -dstnodata nan a.asc a_utm.tif"));
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
  EXPECT_THAT(mercator(folder, 45),
              HasSubstr("of which 1 m is 0.7071 m on the ground here; reproject it with: gdalwarp "
                        "-t_srs EPSG:32632 -novshift -r bilinear -ot Float64 -dstnodata nan a.asc "
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
                        "-dstnodata nan a.img a_north_up.tif"));
}

/// Does what a message advises, in the folder. @return did that work?
bool follow(const TempFolder& folder, const std::string& message, const std::string& from) {
  const std::string command = message.substr(message.find(from));
  return !output_of("cd " + folder.path().string() + " && " + command + " && echo done").empty();
}

enum class Packing { kNone, kScaled, kMoved };
enum class Voids { kNone, kNamed, kUnnamed, kMasked, kMaskedAndNamed };

/// A raster of 8 x 6 cells, how it keeps its heights, and what they are.
struct Kept {
  GDALDataType type = GDT_Float32;
  Packing packing = Packing::kNone;
  Voids voids = Voids::kNone;

  double scale() const { return packing == Packing::kScaled ? 0.5 : 1; }
  double offset() const { return packing == Packing::kNone ? 0 : 1; }
  bool has_minus() const { return type != GDT_Byte && type != GDT_UInt16 && type != GDT_UInt32; }
  double void_value() const {
    if (named()) return has_minus() ? -3000 : 250;
    return voids == Voids::kUnnamed ? (-9999 - offset()) / scale() : 7;
  }
  bool named() const { return voids == Voids::kNamed || voids == Voids::kMaskedAndNamed; }
  bool masked() const { return voids == Voids::kMasked || voids == Voids::kMaskedAndNamed; }
  /// A cell that isn't: where a mask hides it, another has the value that is named.
  bool is_void(int column, int row) const {
    if (voids == Voids::kNone) return false;
    return (column == kVoid && row == kVoid) ||
           (voids == Voids::kMaskedAndNamed && column == kOther && row == kOther);
  }
  std::string text() const {
    return fmt::format("{}{}{}", GDALGetDataTypeName(type),
                       std::array{"", ", scaled", ", moved"}[static_cast<int>(packing)],
                       std::array{"", ", NODATA", ", -9999", ", mask",
                                  ", mask and NODATA"}[static_cast<int>(voids)]);
  }

  /// @param values of the rows from the north @param metres length of the heights' unit
  std::vector<float> truth(const std::vector<double>& values, double metres) const {
    std::vector<float> all;
    for (int j = kRows; j-- > 0;)
      for (int i = 0; i < kColumns; ++i) {
        all.push_back(
            is_void(i, j)
                ? NAN
                : static_cast<float>((values[j * kColumns + i] * scale() + offset()) * metres));
      }
    return all;
  }

  void write(const std::filesystem::path& file, std::vector<double> values, const char* unit,
             const std::string& crs, const std::array<double, 6>& place) const {
    const GdalMessages messages;
    CPLSetThreadLocalConfigOption("GDAL_TIFF_INTERNAL_MASK", "YES");
    const GDALDatasetUniquePtr dataset(GetGDALDriverManager()->GetDriverByName("GTiff")->Create(
        file.c_str(), kColumns, kRows, 1, type, nullptr));
    ASSERT_TRUE(dataset);
    auto transform = place;
    if (place[1] != 0) dataset->SetGeoTransform(transform.data());
    OGRSpatialReference srs;
    if (!crs.empty()) {
      ASSERT_EQ(srs.SetFromUserInput(crs.c_str()), OGRERR_NONE);
      srs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
      dataset->SetSpatialRef(&srs);
    }
    GDALRasterBand& band = *dataset->GetRasterBand(1);
    if (packing != Packing::kNone) {
      band.SetScale(scale());
      band.SetOffset(offset());
    }
    if (unit != nullptr) band.SetUnitType(unit);
    for (int j = 0; j < kRows; ++j)
      for (int i = 0; i < kColumns; ++i)
        if (is_void(i, j)) values[j * kColumns + i] = void_value();
    if (named()) band.SetNoDataValue(void_value());
    if (masked()) {
      ASSERT_EQ(band.CreateMaskBand(GMF_PER_DATASET), CE_None);
      std::vector<std::uint8_t> mask(values.size(), 255);
      mask[kVoid * kColumns + kVoid] = 0;
      ASSERT_EQ(band.GetMaskBand()->RasterIO(GF_Write, 0, 0, kColumns, kRows, mask.data(), kColumns,
                                             kRows, GDT_Byte, 0, 0, nullptr),
                CE_None);
    }
    ASSERT_EQ(band.RasterIO(GF_Write, 0, 0, kColumns, kRows, values.data(), kColumns, kRows,
                            GDT_Float64, 0, 0, nullptr),
              CE_None);
  }

  static constexpr int kColumns = 8, kRows = 6, kVoid = 2, kOther = 4;
};

/// Of all kinds some, each type, packing and way to mark voids among them; of long tests all.
std::vector<Kept> all_kinds() {
  std::vector<Kept> all;
  int kinds = 0;
  for (const GDALDataType type :
       {GDT_Byte, GDT_UInt16, GDT_Int16, GDT_UInt32, GDT_Int32, GDT_Float32, GDT_Float64})
    for (const Packing packing : {Packing::kNone, Packing::kScaled, Packing::kMoved})
      for (const Voids voids :
           {Voids::kNone, Voids::kNamed, Voids::kUnnamed, Voids::kMasked, Voids::kMaskedAndNamed}) {
        const Kept kept{type, packing, voids};
        const bool fits = voids != Voids::kUnnamed || kept.has_minus();
        if (fits && (test::kLong || kinds++ % 7 == 0)) all.push_back(kept);
      }
  return all;
}

std::vector<double> some_values() {
  std::vector<double> values;
  for (int i = 0; i < Kept::kColumns * Kept::kRows; ++i) values.push_back(40 + i * 7 % 199);
  return values;
}

void expect_heights(const RasterInput& raster, const std::vector<float>& truth) {
  const std::vector<float> heights = all_of(raster);
  ASSERT_EQ(heights.size(), truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    EXPECT_EQ(std::isnan(heights[i]), std::isnan(truth[i])) << i;
    if (!std::isnan(truth[i])) {
      EXPECT_NEAR(heights[i], truth[i], 1e-4) << i;
    }
  }
}

constexpr std::array<double, 6> kNorthUp = {500'000, 2, 0, 4'000'000, 0, -2};

TEST(RasterAdvice, IsRightForAllWaysToKeepHeights) {
  if (output_of("command -v gdal_translate").empty())
    GTEST_SKIP() << "GDAL's programs aren't there";
  for (const Kept& kept : all_kinds()) {
    SCOPED_TRACE(kept.text());
    const TempFolder folder;
    kept.write(folder / "metres.tif", some_values(), nullptr, "EPSG:26918", kNorthUp);
    expect_heights(open_raster(folder / "metres.tif"), kept.truth(some_values(), 1));
    kept.write(folder / "feet.tif", some_values(), "ft", "", kNorthUp);
    const std::string message = refusal(folder, folder / "feet.tif");
    ASSERT_TRUE(follow(folder, message, "gdal_translate")) << message;
    expect_heights(open_raster(folder / "feet_m.tif"), kept.truth(some_values(), 0.3048));
    kept.write(folder / "survey.tif", some_values(), nullptr, "EPSG:26918+6360", kNorthUp);
    const std::string of_survey = refusal(folder, folder / "survey.tif");
    EXPECT_THAT(of_survey, HasSubstr("US survey foot"));
    ASSERT_TRUE(follow(folder, of_survey, "gdal_translate")) << of_survey;
    const RasterInput made = open_raster(folder / "survey_m.tif");
    expect_heights(made, kept.truth(some_values(), 1200.0 / 3937));
    EXPECT_EQ(crs_label(made.crs_wkt), "EPSG:26918");
    // A refusal's command must not touch the file itself.
    EXPECT_EQ(refusal(folder, folder / "feet.tif"), message);
  }
}

TEST(RasterAdvice, NamesAllVoidsThatAFileHasNoNameFor) {
  if (output_of("command -v gdalbuildvrt").empty()) GTEST_SKIP() << "GDAL's programs aren't there";
  for (const Kept& kept : {Kept{GDT_Float32}, Kept{GDT_Int32, Packing::kScaled}}) {
    SCOPED_TRACE(kept.text());
    const TempFolder folder;
    std::vector<double> values = some_values();
    std::vector<float> truth = kept.truth(values, 0.3048);
    for (const auto& [column, height] : {std::pair(1, -9999), std::pair(3, -32768),
                                         std::pair(5, 1'000'000), std::pair(6, -9999)}) {
      values[column] = (height - kept.offset()) / kept.scale();
      truth[(Kept::kRows - 1) * Kept::kColumns + column] = NAN;
    }
    kept.write(folder / "a.tif", values, "ft", "EPSG:26918", kNorthUp);
    const std::string message = refusal(folder, folder / "a.tif");
    ASSERT_TRUE(follow(folder, message, "gdal_translate")) << message;
    expect_heights(open_raster(folder / "a_m.tif"), truth);
  }
}

TEST(RasterAdvice, TakesNoHeightInAShortUnitForAVoid) {
  if (output_of("command -v gdal_translate").empty())
    GTEST_SKIP() << "GDAL's programs aren't there";
  const TempFolder folder;
  std::vector<double> values = some_values();
  values[7] = 3'000'000;  // mm
  const Kept kept{GDT_Int32};
  kept.write(folder / "a.tif", values, "mm", "EPSG:26918", kNorthUp);
  const std::string message = refusal(folder, folder / "a.tif");
  ASSERT_TRUE(follow(folder, message, "gdal_translate")) << message;
  expect_heights(open_raster(folder / "a_m.tif"), kept.truth(values, 0.001));
}

TEST(RasterAdvice, KeepsGroundAtZeroAndLeavesOutWhatAnAlphaBandHides) {
  if (output_of("command -v gdal_translate").empty())
    GTEST_SKIP() << "GDAL's programs aren't there";
  constexpr int kColumns = Kept::kColumns, kRows = Kept::kRows, kVoid = 19;
  for (const bool alpha : {false, true}) {
    SCOPED_TRACE(alpha);
    const TempFolder folder;
    std::vector<std::uint16_t> values, seen(kColumns * kRows, 65535);
    std::vector<float> truth;
    for (int i = 0; i < kColumns * kRows; ++i) {
      values.push_back(static_cast<std::uint16_t>(32768 + 100 * (i % 3)));  // 0, 100 and 200 ft
      truth.push_back(static_cast<float>(0.3048 * 100 * (i % 3)));
    }
    values[kVoid] = alpha ? 7 : 0;  // else of common use, once the offset is taken off: -32768
    seen[kVoid] = 0;
    truth[kVoid] = NAN;
    {
      const GdalMessages messages;
      const GDALDatasetUniquePtr dataset(GetGDALDriverManager()->GetDriverByName("GTiff")->Create(
          (folder / "a.tif").c_str(), kColumns, kRows, alpha ? 2 : 1, GDT_UInt16, nullptr));
      std::array<double, 6> south_up = {500'000, 2, 0, 4'000'000, 0, 2};
      dataset->SetGeoTransform(south_up.data());
      dataset->GetRasterBand(1)->SetOffset(-32768);
      dataset->GetRasterBand(1)->SetUnitType("ft");
      if (alpha) dataset->GetRasterBand(2)->SetColorInterpretation(GCI_AlphaBand);
      for (int band = 1; band <= (alpha ? 2 : 1); ++band)
        ASSERT_EQ(dataset->GetRasterBand(band)->RasterIO(
                      GF_Write, 0, 0, kColumns, kRows, band == 1 ? values.data() : seen.data(),
                      kColumns, kRows, GDT_UInt16, 0, 0, nullptr),
                  CE_None);
    }
    const std::string message = refusal(folder, folder / "a.tif");
    ASSERT_TRUE(follow(folder, message, "gdal_translate")) << message;
    expect_heights(open_raster(folder / "a_m.tif"), truth);
  }
}

/// Of a level raster, which no interpolation changes.
void expect_level(const RasterInput& raster, double height_m) {
  int there = 0;
  for (const float z : all_of(raster)) {
    if (std::isnan(z)) continue;
    ++there;
    EXPECT_NEAR(z, height_m, 1e-4);
  }
  EXPECT_GT(there, 12);
  EXPECT_LT(there, 80);
}

TEST(RasterAdvice, ThatReprojectsOrTurnsIsRightForAllWaysToKeepHeights) {
  if (output_of("command -v gdalwarp").empty()) GTEST_SKIP() << "GDAL's programs aren't there";
  const std::vector<double> level(some_values().size(), 120);
  const std::array<double, 6> degrees = {-75, 2e-5, 0, 40, 0, -2e-5};
  const std::array<double, 6> turned = {500'000, 1.8, 0.9, 4'000'000, 0.9, -1.8};
  for (const Kept& kept : all_kinds()) {
    SCOPED_TRACE(kept.text());
    const double height = 120 * kept.scale() + kept.offset();
    const TempFolder folder;
    kept.write(folder / "degrees.tif", level, nullptr, "EPSG:4326", degrees);
    std::string message = refusal(folder, folder / "degrees.tif");
    ASSERT_TRUE(follow(folder, message, "gdal")) << message;
    expect_level(open_raster(folder / "degrees_utm.tif"), height);
    kept.write(folder / "turned.tif", level, nullptr, "EPSG:26918", turned);
    message = refusal(folder, folder / "turned.tif");
    ASSERT_TRUE(follow(folder, message, "gdal")) << message;
    expect_level(open_raster(folder / "turned_north_up.tif"), height);
    // Degrees, and heights in feet: both at once, for in between the unit is lost.
    kept.write(folder / "both.tif", level, "ft", "EPSG:4326", degrees);
    message = refusal(folder, folder / "both.tif");
    ASSERT_TRUE(follow(folder, message, "gdal")) << message;
    expect_level(open_raster(folder / "both_m_utm.tif"), height * 0.3048);
  }
}

TEST(RasterAdvice, ForCoordinatesInFeetIsRightWhateverHeightsAreIn) {
  if (output_of("command -v gdalwarp").empty()) GTEST_SKIP() << "GDAL's programs aren't there";
  const std::vector<double> level(some_values().size(), 120);
  const std::array<double, 6> place = {2'000'000, 6, 0, 700'000, 0, -6};
  const TempFolder folder;
  Kept{}.write(folder / "a.tif", level, nullptr, "EPSG:2263", place);
  const std::string message = refusal(folder, folder / "a.tif");
  EXPECT_THAT(message, HasSubstr("doesn't give the unit of its heights"));
  const std::size_t feet = message.find(" ; if they are in");
  ASSERT_NE(feet, message.npos);
  ASSERT_TRUE(follow(folder, message.substr(0, feet), "gdalwarp")) << message;
  expect_level(open_raster(folder / "a_utm.tif"), 120);
  ASSERT_TRUE(follow(folder, message.substr(feet), "gdal_translate")) << message;
  expect_level(open_raster(folder / "a_m_utm.tif"), 120 * 1200.0 / 3937);
  struct Known {
    const char *name, *crs, *unit;
  };
  for (const auto& [name, crs, unit] :
       {Known{"b", "EPSG:2263+6360", nullptr}, Known{"c", "EPSG:2263", "US survey foot"}}) {
    Kept{}.write(folder / fmt::format("{}.tif", name), level, unit, crs, place);
    const std::string known = refusal(folder, folder / fmt::format("{}.tif", name));
    EXPECT_THAT(known, HasSubstr("heights are in 'US survey foot'"));
    ASSERT_TRUE(follow(folder, known, "gdal_translate")) << known;
    expect_level(open_raster(folder / fmt::format("{}_m_utm.tif", name)), 120 * 1200.0 / 3937);
  }
}

TEST(RasterAdvice, GivesARasterItsPlace) {
  if (output_of("command -v gdal_translate").empty())
    GTEST_SKIP() << "GDAL's programs aren't there";
  for (const Kept& kept : all_kinds()) {
    SCOPED_TRACE(kept.text());
    const TempFolder folder;
    kept.write(folder / "a.tif", some_values(), nullptr, "", {});
    std::string message = refusal(folder, folder / "a.tif");
    for (const auto& [name, value] : {std::pair("<xmin>", "100"), std::pair("<ymax>", "212"),
                                      std::pair("<xmax>", "116"), std::pair("<ymin>", "200")}) {
      ASSERT_NE(message.find(name), message.npos) << message;
      message.replace(message.find(name), 6, value);
    }
    ASSERT_TRUE(follow(folder, message, "gdal")) << message;
    const RasterInput made = open_raster(folder / "a_placed.tif");
    EXPECT_EQ(made.grid.first, Vec2(101, 201));
    expect_heights(made, kept.truth(some_values(), 1));
  }
}

TEST(RasterAdvice, ForFeetWithoutAPlaceConvertsThemOnce) {
  if (output_of("command -v gdalwarp").empty()) GTEST_SKIP() << "GDAL's programs aren't there";
  const std::vector<double> level(some_values().size(), 120);
  const TempFolder folder;
  Kept{}.write(folder / "a.tif", level, "US survey foot", "EPSG:2263", {});
  std::string message = refusal(folder, folder / "a.tif");
  for (const auto& [name, value] :
       {std::pair("<xmin>", "2000000"), std::pair("<ymax>", "700036"),
        std::pair("<xmax>", "2000048"), std::pair("<ymin>", "700000")}) {
    ASSERT_NE(message.find(name), message.npos) << message;
    message.replace(message.find(name), 6, value);
  }
  ASSERT_TRUE(follow(folder, message, "gdal_translate")) << message;
  message = refusal(folder, folder / "a_placed.tif");
  EXPECT_THAT(message, HasSubstr("heights are in 'US survey foot'"));
  ASSERT_TRUE(follow(folder, message, "gdal_translate")) << message;
  expect_level(open_raster(folder / "a_placed_m_utm.tif"), 120 * 1200.0 / 3937);
}

TEST(RasterAdvice, MakesAGeoTiffOfOtherFormats) {
  if (output_of("command -v gdal_translate").empty())
    GTEST_SKIP() << "GDAL's programs aren't there";
  for (const Kept& kept : all_kinds()) {
    SCOPED_TRACE(kept.text());
    const TempFolder folder;
    kept.write(folder / "b.tif", some_values(), nullptr, "EPSG:26918", kNorthUp);
    ASSERT_FALSE(
        output_of("cd " + folder.path().string() + " && gdal_translate -of VRT b.tif a.vrt")
            .empty());
    const std::string message = refusal(folder, folder / "a.vrt");
    ASSERT_TRUE(follow(folder, message, "gdal")) << message;
    expect_heights(open_raster(folder / "a_geotiff.tif"), kept.truth(some_values(), 1));
  }
}

TEST(RasterAdvice, WarnsOfGreysAndOfHeightsThatMayBeVoids) {
  const TempFolder folder;
  Kept{GDT_Byte}.write(folder / "grey.tif", some_values(), nullptr, "EPSG:26918", kNorthUp);
  ASSERT_EQ(open_raster(folder / "grey.tif").warnings.size(), 1U);
  EXPECT_THAT(open_raster(folder / "grey.tif").warnings[0], HasSubstr("8-bit greys"));
  Kept{GDT_Byte}.write(folder / "m.tif", some_values(), "m", "EPSG:26918", kNorthUp);
  EXPECT_TRUE(open_raster(folder / "m.tif").warnings.empty());
  Kept{GDT_Byte, Packing::kScaled}.write(folder / "dm.tif", some_values(), nullptr, "EPSG:26918",
                                         kNorthUp);
  EXPECT_TRUE(open_raster(folder / "dm.tif").warnings.empty());
  auto values = some_values();
  values[5] = -9999;
  Kept{GDT_Float32, Packing::kNone, Voids::kNamed}.write(folder / "named.tif", values, nullptr,
                                                         "EPSG:26918", kNorthUp);
  const RasterInput named = open_raster(folder / "named.tif");
  ASSERT_EQ(named.warnings.size(), 1U);
  EXPECT_THAT(named.warnings[0], HasSubstr("has heights of -9999 m"));
  EXPECT_EQ(std::ranges::count(all_of(named), -9999.0F), 1) << "a file's own NODATA is believed";
  // Packed and unnamed, what a void would be kept as is another height.
  Kept{GDT_Int16, Packing::kScaled}.write(folder / "packed.tif", values, nullptr, "EPSG:26918",
                                          kNorthUp);
  const RasterInput packed = open_raster(folder / "packed.tif");
  ASSERT_EQ(packed.warnings.size(), 1U);
  EXPECT_THAT(packed.warnings[0], HasSubstr("has heights of -4998.5 m"));
  EXPECT_EQ(std::ranges::count(all_of(packed), -4998.5F), 1);
}

TEST(RasterAdvice, TellsCrsThatDiffer) {
  const auto wkt = [](const char* name) {
    const GdalMessages messages;
    OGRSpatialReference srs;
    EXPECT_EQ(srs.SetFromUserInput(name), OGRERR_NONE);
    char* text = nullptr;
    const char* const options[] = {"FORMAT=WKT2_2019", nullptr};
    srs.exportToWkt(&text, options);
    const std::string all = text;
    CPLFree(text);
    return all;
  };
  const auto between = [&](const char* a, const char* b) {
    return crs_differences("A", *a ? wkt(a) : "", "B", *b ? wkt(b) : "");
  };
  EXPECT_TRUE(between("EPSG:25832+7837", "EPSG:25832+7837").empty());
  EXPECT_TRUE(between("EPSG:25832", "EPSG:25832").empty());
  EXPECT_TRUE(between("", "").empty());
  const auto vertical = between("EPSG:25832+7837", "EPSG:25832+5783");
  ASSERT_EQ(vertical.size(), 1U);
  EXPECT_THAT(vertical[0], HasSubstr("heights of A are in EPSG:7837, and those of B in EPSG:5783"));
  const auto horizontal = between("EPSG:25832", "EPSG:25833");
  ASSERT_EQ(horizontal.size(), 1U);
  EXPECT_THAT(horizontal[0], HasSubstr("coordinates of A are in EPSG:25832"));
  EXPECT_EQ(between("EPSG:25832+7837", "EPSG:25833+5783").size(), 2U);
  const auto unknown = between("EPSG:25832+7837", "EPSG:25832");
  ASSERT_EQ(unknown.size(), 1U);
  EXPECT_THAT(unknown[0], HasSubstr("heights of A are in EPSG:7837, and B names none"));
  EXPECT_EQ(between("EPSG:4979", "EPSG:25832").size(), 2U);
  const auto above_ellipsoid = between("EPSG:4979", "EPSG:4326");
  ASSERT_EQ(above_ellipsoid.size(), 1U) << "of one place, with and without a height";
  EXPECT_THAT(above_ellipsoid[0], HasSubstr("and B names none"));
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
