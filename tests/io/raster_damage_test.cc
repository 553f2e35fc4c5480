// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Files that are damaged, or no rasters that are read as terrain: refused in one line.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "soilvdb/io/raster.h"
#include "tests/support/raster_fixture.h"
#include "tests/support/temp_folder.h"

extern "C" int GDALGetDriverCount();
extern "C" void GDALAllRegister();

namespace soilvdb::io {
namespace raster_damage_test {

using test::TempFolder;
using ::testing::HasSubstr;

TEST(Raster, ARowOfGigabytesIsRefusedUnread) {
  const TempFolder folder;
  std::ifstream in(SOILVDB_SOURCE_DIR "/tests/fuzz/regressions/raster/row_of_6_GB",
                   std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(in), {});
  ASSERT_FALSE(bytes.empty());
  EXPECT_EQ(refusal(folder, folder.write("a.grd", bytes.substr(1))),
            "a.grd: is damaged or has too large blocks, 761754371 x 1 cells, of which each is read "
            "whole; make tiles with: gdal_translate --config GDAL_TIFF_INTERNAL_MASK YES "
            "-co TILED=YES a.grd a_tiled.tif");
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
  EXPECT_THAT(refusal(folder, vrt), HasSubstr("is not a raster format for terrain"));
  EXPECT_THAT(refusal(folder, vrt), HasSubstr("gdal_translate"));
}

TEST(Raster, AByteOrderMarkIsToldWithTheCommandThatRemovesIt) {
  const TempFolder folder;
  const auto file = folder.write("a.asc", "\xEF\xBB\xBF" + ascii("4 5 6\n1 2 3\n"));
  const std::string why = refusal(folder, file);
  EXPECT_THAT(why, HasSubstr("a.asc: begins with a byte order mark"));
  const std::string mend = "cd '" + folder.path().string() + "' && " + why.substr(why.find("sed "));
  ASSERT_EQ(std::system(mend.c_str()), 0);
  EXPECT_EQ(refusal(folder, file), "accepted");
}

TEST(Raster, FormatsThatHoldNoHeightsAreUnknownToGdalHere) {
  const TempFolder folder;
  refusal(folder, folder.write("empty.tif", ""));
  EXPECT_EQ(GDALGetDriverCount(), 18) << "as many as io/terrain/gdal.cc names";
  // Whoever links us may use all that GDAL has; we still don't.
  GDALAllRegister();
  folder.write("a.asc", ascii("4 5 6\n1 2 3\n"));
  ASSERT_EQ(std::system(fmt::format("gdal_translate -q -of PNG -ot UInt16 '{0}/a.asc' '{0}/a.png'",
                                    folder.path().string())
                            .c_str()),
            0);
  EXPECT_THAT(refusal(folder, folder / "a.png"), HasSubstr("is not a raster format for terrain"));
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

TEST(Raster, GdalPrintsNothing) {
  const TempFolder folder;
  ::testing::internal::CaptureStderr();
  refusal(folder, folder.write("a.tif", std::string("II*\0\x08\0\0\0\xff\xff garbage", 18)));
  refusal(folder, folder.write("a.asc", ascii("4 5 6\n1 x\n")));
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
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

}  // namespace raster_damage_test
}  // namespace soilvdb::io
