// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rasters of heights. The first byte chooses the format by its files' names; where it takes two
// files, the next two bytes say how many of the bytes after them are the header's.
#include <algorithm>
#include <vector>

#include "soilvdb/io/raster.h"
#include "tests/fuzz/fuzz.h"

using namespace soilvdb;

namespace {

struct Names {
  const char* heights;
  const char* header;
};
constexpr Names kNames[] = {{"a.tif", nullptr},       {"a.asc", "a.prj"},        {"a.bil", "a.hdr"},
                            {"a.img", nullptr},       {"a.dat", "a.hdr"},        {"a.grd", nullptr},
                            {"N45E006.hgt", nullptr}, {"a.sdat", "a.sgrd"},      {"a.dt0", nullptr},
                            {"a.dem", nullptr},       {"a.tif", "a.tif.aux.xml"}};

/// GDAL and the database of CRS are loaded by a process's first raster: no input pays for that.
bool load_gdal() {
  const test::TempFolder folder;
  folder.write("a.prj", "EPSG:32632");
  return io::open_raster(folder.write("a.asc",
                                      "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\n"
                                      "cellsize 1\n1 1\n1 1\n"))
             .grid.nx == 2;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const bool loaded = load_gdal();
  fuzz::require(loaded, "a raster of four heights is read");
  std::string_view rest = fuzz::text(data, size);
  if (rest.size() < 3) return 0;
  const Names names = kNames[data[0] % std::size(kNames)];
  rest.remove_prefix(1);
  const test::TempFolder folder;
  if (names.header) {
    const std::size_t header = data[1] + std::size_t{256} * data[2];
    rest.remove_prefix(2);
    folder.write(names.header, rest.substr(0, header));
    rest.remove_prefix(std::min(rest.size(), header));
  }
  const auto file = folder.write(names.heights, rest);
  fuzz::expect_read_or_refused([&] {
    const io::RasterInput raster = io::open_raster(file);
    const int nx = std::min(raster.grid.nx, 64), ny = std::min(raster.grid.ny, 64);
    std::vector<float> heights(std::size_t(nx) * ny);
    try {
      raster.source->read(raster.grid.nx - nx, raster.grid.ny - ny, nx, ny, heights.data());
    } catch (const std::runtime_error& damage) {
      fuzz::check_message(damage);
    }
  });
  return 0;
}
