// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Surfaces of triangles in LandXML or DXF, and lines in DXF, GeoJSON or LandXML, by the first byte.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <vector>

#include "io/terrain/design_lines.h"
#include "soilvdb/io/raster.h"
#include "tests/fuzz/fuzz.h"

using namespace soilvdb;

namespace {

/// GDAL is loaded by a process's first raster: no input pays for that.
bool load_gdal() {
  const test::TempFolder folder;
  const char* const points =
      "<LandXML><CoordinateSystem epsgCode='32632'/><Surfaces><Surface name='a'><Definition>"
      "<Pnts><P id='1'>0 500000 0</P><P id='2'>0 500001 0</P><P id='3'>1 500000 0</P></Pnts>"
      "<Faces><F>1 2 3</F></Faces></Definition></Surface></Surfaces></LandXML>";
  return !io::open_raster(folder.write("a.xml", points)).crs_wkt.empty();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const bool loaded = load_gdal();
  fuzz::require(loaded, "a surface of one face is read");
  if (size < 1) return 0;
  const test::TempFolder folder;
  constexpr const char* kNames[] = {"a.xml", "a.dxf", "a.dxf", "a.geojson", "a.xml"};
  const std::size_t kind = data[0] % std::size(kNames);
  const auto file = folder.write(kNames[kind], fuzz::text(data + 1, size - 1));
  fuzz::expect_read_or_refused([&] {
    if (kind >= 2) {
      for (const auto& line : io::read_lines(file, "").lines)
        fuzz::require(line.size() >= 2, "a line has points");
      return;
    }
    const io::RasterInput surface = io::open_raster(file);
    const HeightGrid& grid = surface.grid;
    fuzz::require(grid.nx >= 2 && grid.ny >= 2 && double(grid.nx) * grid.ny <= 1 << 24,
                  "posts are neither too few nor too many");
    fuzz::require(grid.first.allFinite() && grid.spacing.allFinite() && grid.spacing.minCoeff() > 0,
                  "posts have places");
    const int nx = std::min(grid.nx, 64), ny = std::min(grid.ny, 64);
    std::vector<float> heights(std::size_t(nx) * ny);
    surface.source->read(grid.nx - nx, grid.ny - ny, nx, ny, heights.data());
    fuzz::require(std::all_of(heights.begin(), heights.end(),
                              [](float z) { return !(std::abs(z) > 1.001e5F); }),
                  "heights are those of a terrain, or none");
  });
  return 0;
}
