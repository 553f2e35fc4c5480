// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Height rasters by GDAL: opened by window, written as GeoTIFF.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "soilvdb/ground.h"
#include "soilvdb/initial_terrain.h"
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {

struct RasterInput {
  HeightGrid grid;
  std::shared_ptr<const HeightSource> source;  ///< safe to call from several threads
  std::string crs_wkt;                         ///< empty: unknown, taken as metres
  std::string driver;                          ///< GDAL's name of the format
  std::vector<std::string> warnings;           ///< about heights that may be voids, a line each
};

/// Opens the first band of a raster as heights in metres: integers and floats of any width, with
/// scale and offset applied, in any row order. Posts are the cells' centres. Reads a small part of
/// a large file (at most 0.1 s), and all of a small one.
///
/// Cells without a height: NODATA, masked and fully transparent cells, NaN, infinities, and heights
/// beyond +-1e5 m. If no NODATA is declared, also heights of exactly -9999, -99999, -32768 and
/// -32767 m, which often mark voids. A declared NODATA holds, even if it is 0.
///
/// Formats: GeoTIFF and COG, Esri ASCII, binary and .bil, GRASS ASCII, ENVI, Erdas .img, Surfer
/// grids, SAGA, SRTM .hgt, DTED, USGS DEM; triangles of LandXML and DXF, one of several surfaces as
/// "site.xml#Name", at posts over their bounds, with units and CRS in metres. Other formats of GDAL
/// must be converted first (VRT and the like refer to other files and addresses); the error gives
/// the command.
/// @throw InputError if the file is missing, damaged, not a raster of heights, without a position,
///        rotated, in degrees or feet (with the command that converts it), or without any height.
///        The source's read() throws std::runtime_error naming the file if damage shows later.
RasterInput open_raster(const std::filesystem::path& file);

/// One band of a raster to write: row-major from low y to high y, NaN where there is no height.
struct RasterBand {
  std::string name;
  std::vector<float> values;
  std::string unit = "metre";  ///< empty: a number
};

/// Writes a Float32 GeoTIFF (deflate, tiled), north up, NODATA -9999. Atomic.
/// @param grid square cells or not; its posts become the cells' centres
/// @throw std::runtime_error naming the file and the cause.
void write_geotiff(const std::filesystem::path& file, const HeightGrid& grid,
                   const std::vector<RasterBand>& bands, const std::string& crs_wkt);

/// The most cells that a run writes; two such bands are 0.8 GB.
inline constexpr double kMostRasterCells = 1e8;

/// Heights of a site's surface on a grid of square cells, and its height above the ground before
/// digging, beneath all snapshots that it was dug from.
struct SurfaceRaster {
  HeightGrid grid;
  std::vector<float> surface, base, change;  ///< NaN where there is no ground
};

/// Rasterises the cells that meet the box, with sides at multiples of cell_m, in parallel. The base
/// has the heights at the cells' centres. The change is the soil that a cell gained divided by its
/// area, so the changes' sum times a cell's area is the change in volume. This includes cells at
/// the edge of the terrain whose centres have no height. The surface is base plus change. For cells
/// smaller than voxels, the surface also has the heights at the centres, and the change is the
/// difference.
/// @param box in the world, m, not empty
/// @throw std::invalid_argument unless 0 < cell_m and there are at most 2^31 cells.
SurfaceRaster rasterise(const Ground& ground, const Eigen::AlignedBox2d& box, double cell_m);

/// Rise of the ground between two states, in the cells of a raster of the later state, m.
/// @param same_base as in difference()
std::vector<float> rasterise_change(const Ground& before, const Ground& after, bool same_base,
                                    const SurfaceRaster& raster);

}  // namespace soilvdb::inline v0::io
