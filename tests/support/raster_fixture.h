// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rasters written for tests or shared with us, and what is read or said of them.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "soilvdb/io/raster.h"
#include "tests/support/shared_data.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {

inline constexpr const char* kUtm17 =
    "PROJCS[\"WGS 84 / UTM zone 17N\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\","
    "6378137,298.257223563]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],"
    "PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],"
    "PARAMETER[\"central_meridian\",-81],PARAMETER[\"scale_factor\",0.9996],"
    "PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\",0],UNIT[\"metre\",1],"
    "AUTHORITY[\"EPSG\",\"32617\"]]";

/// An Esri ASCII grid of 3 x 2 cells of 2 m at (100, 200).
inline std::string ascii(const std::string& values, const std::string& more = "") {
  return "ncols 3\nnrows 2\nxllcorner 100\nyllcorner 200\ncellsize 2\n" + more + values;
}

inline std::vector<float> all_of(const RasterInput& raster) {
  std::vector<float> out(std::size_t(raster.grid.nx) * raster.grid.ny);
  raster.source->read(0, 0, raster.grid.nx, raster.grid.ny, out.data());
  return out;
}

inline std::string refusal(const test::TempFolder& folder, const std::filesystem::path& file) {
  try {
    open_raster(file);
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), ::testing::Not(::testing::HasSubstr("\n")));
    return test::message_of(folder, [&] { throw e; });
  }
  return "accepted";
}

#define SKIP_UNLESS_THERE(file) \
  if (!std::filesystem::exists(file)) GTEST_SKIP() << (file) << " is not there"

/// What a shell command prints; nothing if it fails.
inline std::string output_of(const std::string& command) {
  std::FILE* pipe = ::popen((command + " 2>/dev/null").c_str(), "r");
  std::string text;
  char buffer[4096];
  for (std::size_t n; (n = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) text.append(buffer, n);
  return ::pclose(pipe) == 0 ? text : "";
}

inline HeightGrid grid_of(int nx, int ny, Vec2 first, Vec2 spacing) {
  return {nx, ny, first, spacing};
}

}  // namespace soilvdb::io
