// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Properties of a raster, whether or not its heights are usable.
#pragma once

#include <filesystem>
#include <string>

#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

struct RasterFacts {
  std::string driver;  ///< GDAL's name of the format
  int columns = 0, rows = 0, bands = 0;
  int block_columns = 0;     ///< width of its storage blocks
  std::string value_type;    ///< of the first band, such as "Float32"
  std::string nodata;        ///< of the first band; empty: no NODATA
  bool placed = false;       ///< it has a position; if not, cell and box mean nothing
  Vec2 cell = Vec2::Zero();  ///< in units of its CRS
  Eigen::AlignedBox2d box;   ///< outer edges of its cells, in its CRS
  std::string crs_wkt;       ///< empty: unknown
};

/// @throw InputError if GDAL can't open it as a raster.
RasterFacts raster_facts(const std::filesystem::path& file);

}  // namespace soilvdb::inline v0::io
