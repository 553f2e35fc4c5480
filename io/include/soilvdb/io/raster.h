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
  std::string crs_wkt;                         ///< empty: not known, taken as metres
  std::string driver;                          ///< GDAL's name of the format
  std::vector<std::string> warnings;           ///< of heights that may be none, each a line
};

/// Opens the first band of a raster as heights in metres: integers and floats of any width, scale
/// and offset applied, whichever way its rows run. Posts are the cells' centres. Reads little of a
/// large file (0.1 s or less), all of a small one.
///
/// No height is: NODATA, masked and fully transparent cells, NaN, infinities, heights beyond
/// +-1e5 m, and where no NODATA is declared, heights of exactly -9999, -99999, -32768 and -32767 m,
/// with which files mark voids. A declared NODATA is taken at its word, also if it is 0.
///
/// Formats: GeoTIFF and COG, Esri ASCII, binary and .bil, GRASS ASCII, ENVI, Erdas .img, Surfer
/// grids, SAGA, SRTM .hgt, DTED, USGS DEM. What GDAL reads else (VRT and the like refer to other
/// files and addresses) has to be converted first, and the error says how.
/// @throw InputError if it is missing, damaged, not a raster of heights, without a position,
/// rotated,
///        in degrees or feet (with the command that would mend it), or has no height at all. The
///        source's read() throws std::runtime_error naming the file if damage shows later.
RasterInput open_raster(const std::filesystem::path& file);

/// One band of a raster to write: row-major from low y to high y, NaN where there is none.
struct RasterBand {
  std::string name;
  std::vector<float> values;
};

/// Writes a Float32 GeoTIFF (deflate, tiled), north up, NODATA -9999, unit metre. Atomic.
/// @param grid square or not; its posts become the centres of the cells
/// @throw std::runtime_error naming the file and the cause.
void write_geotiff(const std::filesystem::path& file, const HeightGrid& grid,
                   const std::vector<RasterBand>& bands, const std::string& crs_wkt);

/// As many cells as a run writes: two bands of them are 0.8 GB.
inline constexpr double kMostRasterCells = 1e8;

/// Heights of a site's surface on a grid of square cells, and how far it is above the ground before
/// anyone dug there, beneath all snapshots that one was dug from.
struct SurfaceRaster {
  HeightGrid grid;
  std::vector<float> surface, base, change;  ///< NaN where there is no ground
};

/// The cells that meet the box, their sides at multiples of cell_m. The base's heights are those of
/// the cells' centres; the change is what soil the cell gained over its area, so that its sum times
/// the area of a cell is the ground's change in volume, that of cells at the edge of the terrain
/// whose centres have no height included; the surface is their sum. Where cells are smaller than
/// voxels, the surface's heights are those of its centres, too, and the change is the difference.
/// In parallel.
/// @param box in the world, m, not empty
/// @throw std::invalid_argument unless 0 < cell_m and there are at most 2^31 cells.
SurfaceRaster rasterise(const Ground& ground, const Eigen::AlignedBox2d& box, double cell_m);

/// By how much the ground rose from one state to another in the cells of a raster of the latter, m.
/// @param same_base as for difference()
std::vector<float> rasterise_change(const Ground& before, const Ground& after, bool same_base,
                                    const SurfaceRaster& raster);

}  // namespace soilvdb::inline v0::io
