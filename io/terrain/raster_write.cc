// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Writing heights.
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "io/file/atomic_file.h"
#include "io/terrain/gdal.h"
#include "soilvdb/difference.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/surface_height.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr float kNoData = -9999;
constexpr double kMostTiffCells = 2147483647.0;

/// Adds a column's gain to the rise of the cells that it meets.
VolumeChangeFunction add_to(const HeightGrid& cells, std::vector<double>& rise_m) {
  const double side_m = cells.spacing.x();
  rise_m.resize(std::size_t(cells.nx) * cells.ny);
  return [&cells, &rise_m, side_m](const VolumeBins::Box& column, const VolumeChange& gain) {
    const int i = column[0], j = column[1];
    if (i >= 0 && i < cells.nx && j >= 0 && j < cells.ny)
      rise_m[std::size_t(j) * cells.nx + i] += gain.m3 / (side_m * side_m);
  };
}

/// A cell's rise, also if its centre has no height; empty where there is no ground.
float change_of(double rise_m, double base_m) {
  return static_cast<float>(std::isnan(base_m) && rise_m == 0 ? base_m : rise_m);
}

}  // namespace

void write_geotiff(const std::filesystem::path& file, const HeightGrid& grid,
                   const std::vector<RasterBand>& bands, const std::string& crs_wkt) {
  const GdalMessages messages;
  const auto require = [&](bool good) {
    if (good) return;
    throw std::runtime_error(file.string() +
                             ": can't be written: " + messages.error_or("GDAL gives no reason"));
  };
  const std::size_t cells = std::size_t(grid.nx) * grid.ny;
  for (const RasterBand& band : bands) {
    if (band.values.size() != cells)
      throw std::invalid_argument("a band is not of the grid's size");
  }
  MemoryFile memory(".tif");
  const GDALDriverH driver = gdal().GDALGetDriverByName("GTiff");
  require(driver != nullptr);
  const char* const options[] = {"COMPRESS=DEFLATE", "PREDICTOR=3",     "TILED=YES",
                                 "BIGTIFF=IF_SAFER", "INTERLEAVE=BAND", nullptr};
  GdalDataset dataset(gdal().GDALCreate(driver, memory.path(), grid.nx, grid.ny,
                                        static_cast<int>(bands.size()), GDT_Float32, options));
  require(dataset != nullptr);
  double transform[6] = {grid.first.x() - grid.spacing.x() / 2,
                         grid.spacing.x(),
                         0,
                         grid.first.y() + (grid.ny - 0.5) * grid.spacing.y(),
                         0,
                         -grid.spacing.y()};
  require(gdal().GDALSetGeoTransform(dataset.get(), transform) == CE_None);
  if (!crs_wkt.empty()) {
    const OwnSrs srs = srs_of(crs_wkt);
    require(srs != nullptr);
    gdal().OSRSetAxisMappingStrategy(srs.get(), OAMS_TRADITIONAL_GIS_ORDER);
    require(gdal().GDALSetSpatialRef(dataset.get(), srs.get()) == CE_None);
  }
  std::vector<float> rows(cells);
  for (std::size_t b = 0; b < bands.size(); ++b) {
    for (int y = 0; y < grid.ny; ++y) {
      const float* from = &bands[b].values[std::size_t(grid.ny - 1 - y) * grid.nx];
      float* to = &rows[std::size_t(y) * grid.nx];
      for (int x = 0; x < grid.nx; ++x) to[x] = std::isnan(from[x]) ? kNoData : from[x];
    }
    const GDALRasterBandH band = gdal().GDALGetRasterBand(dataset.get(), static_cast<int>(b) + 1);
    gdal().GDALSetDescription(band, bands[b].name.c_str());
    require(gdal().GDALSetRasterNoDataValue(band, kNoData) == CE_None);
    require(gdal().GDALSetRasterUnitType(band, bands[b].unit.c_str()) == CE_None);
    require(gdal().GDALRasterIO(band, GF_Write, 0, 0, grid.nx, grid.ny, rows.data(), grid.nx,
                                grid.ny, GDT_Float32, 0, 0) == CE_None);
  }
  dataset.reset();  // completes the file
  require(messages.error().empty() && !memory.bytes().empty());
  write_atomically(file, memory.bytes());
}

SurfaceRaster rasterise(const Ground& ground, const Eigen::AlignedBox2d& box, double cell_m) {
  if (!(cell_m > 0) || box.isEmpty()) {
    throw std::invalid_argument("a raster needs a box and cells above 0 m");
  }
  const Eigen::Array2d low = (box.min().array() / cell_m).floor();
  const Eigen::Array2d size = ((box.max().array() / cell_m).ceil() - low).max(1.0);
  if (!(size.prod() <= kMostTiffCells)) {
    throw std::invalid_argument(fmt::format(
        "a raster of {:.0f} x {:.0f} cells is too large; larger cells than {:g} m would do",
        size.x(), size.y(), cell_m));
  }
  SurfaceRaster out;
  out.grid.nx = static_cast<int>(size.x());
  out.grid.ny = static_cast<int>(size.y());
  out.grid.first = (low + 0.5) * cell_m;
  out.grid.spacing = Vec2::Constant(cell_m);
  const std::size_t cells = std::size_t(out.grid.nx) * out.grid.ny;
  // A voxel has too few samples for smaller cells.
  std::vector<double> rise_m;
  if (cell_m > 0.999 * ground.voxel_size_m()) {
    const VolumeChangeFunction add = add_to(out.grid, rise_m);
    for (const Ground* s = &ground; s != nullptr; s = s->terrain().ground())
      for_each_volume_change(*s, VolumeBins::columns(out.grid.first, cell_m), add);
  }
  out.surface.resize(cells);
  out.base.resize(cells);
  out.change.resize(cells);
  const InitialTerrain& undug = ground.initial_terrain();
  const auto heights = surface_heights(ground);
  tbb::parallel_for(0, out.grid.ny, [&](int j) {
    constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
    const double y = out.grid.first.y() + j * cell_m;
    for (int i = 0; i < out.grid.nx; ++i) {
      const double x = out.grid.first.x() + i * cell_m;
      const std::size_t n = std::size_t(j) * out.grid.nx + i;
      const double base = undug.height(x, y).value_or(kUnknown);
      const double surface = rise_m.empty() ? heights(x, y).value_or(kUnknown) : base + rise_m[n];
      out.surface[n] = static_cast<float>(surface);
      out.base[n] = static_cast<float>(base);
      out.change[n] =
          rise_m.empty() ? static_cast<float>(surface - base) : change_of(rise_m[n], base);
    }
  });
  return out;
}

std::vector<float> rasterise_change(const Ground& before, const Ground& after, bool same_base,
                                    const SurfaceRaster& raster) {
  std::vector<double> rise_m;
  for_each_volume_change(before, after, same_base,
                         VolumeBins::columns(raster.grid.first, raster.grid.spacing.x()),
                         add_to(raster.grid, rise_m));
  std::vector<float> change(rise_m.size());
  for (std::size_t i = 0; i < change.size(); ++i)
    change[i] = change_of(rise_m[i], double{raster.base[i]});
  return change;
}

}  // namespace soilvdb::inline v0::io
