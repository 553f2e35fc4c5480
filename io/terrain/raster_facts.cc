// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/raster_facts.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <string>

#include "io/file/text.h"
#include "io/terrain/gdal.h"
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {

RasterFacts raster_facts(const std::filesystem::path& file) {
  check_readable(file);
  GdalMessages messages;
  const std::string format = height_format(file);
  const char* const formats[] = {format.c_str(), nullptr};
  const GdalDataset raster(
      format.empty() ? nullptr
                     : gdal().GDALOpenEx(file.c_str(),
                                         GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR,
                                         formats, nullptr, nullptr));
  if (!raster || gdal().GDALGetRasterCount(raster.get()) < 1)
    throw InputError(
        file, fmt::format("is not a readable raster: {}",
                          messages.error_or("its format is not supported, or it has no bands")));
  RasterFacts facts;
  facts.driver = driver_of(raster);
  facts.columns = gdal().GDALGetRasterXSize(raster.get());
  facts.rows = gdal().GDALGetRasterYSize(raster.get());
  facts.bands = gdal().GDALGetRasterCount(raster.get());
  const GDALRasterBandH band = gdal().GDALGetRasterBand(raster.get(), 1);
  int block_rows = 0;
  gdal().GDALGetBlockSize(band, &facts.block_columns, &block_rows);
  facts.value_type = gdal().GDALGetDataTypeName(gdal().GDALGetRasterDataType(band));
  int has_nodata = 0;
  const double nodata = gdal().GDALGetRasterNoDataValue(band, &has_nodata);
  if (has_nodata) facts.nodata = fmt::format("{}", nodata);
  std::array<double, 6> t{};  // x = t0 + column t1 + row t2, y = t3 + column t4 + row t5
  if (gdal().GDALGetGeoTransform(raster.get(), t.data()) == CE_None) {
    facts.placed = true;
    facts.cell = {std::hypot(t[1], t[4]), std::hypot(t[2], t[5])};
    for (const int column : {0, facts.columns})
      for (const int row : {0, facts.rows})
        facts.box.extend(
            Vec2(t[0] + column * t[1] + row * t[2], t[3] + column * t[4] + row * t[5]));
  }
  if (const char* wkt = gdal().GDALGetProjectionRef(raster.get())) facts.crs_wkt = wkt;
  return facts;
}

}  // namespace soilvdb::inline v0::io
