// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reading heights.
#include "soilvdb/io/raster.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <optional>

#include "io/file/text.h"
#include "io/terrain/crs.h"
#include "io/terrain/gdal.h"
#include "io/terrain/gdal_heights.h"
#include "io/terrain/raster_advice.h"
#include "io/terrain/tin.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kMostPosts = 4e11;  // a state of 600 km x 600 km at 1 m
constexpr double kLargeBlock_bytes = 256 << 20, kMostPacked = 1000;  // deflate's limit
constexpr std::int64_t kReadWholeBytes = 1 << 24;

/// A sample of a raster's heights.
struct Probe {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  bool whole = false;             ///< all heights were read
  std::optional<float> doubtful;  ///< a height that may be a void
};

/// As some programs of Windows begin texts.
bool begins_with_order_mark(const std::filesystem::path& file) {
  std::array<char, 3> bytes = {};
  return std::ifstream(file, std::ios::binary).read(bytes.data(), bytes.size()) &&
         bytes == std::array<char, 3>{'\xEF', '\xBB', '\xBF'};
}

GdalDataset open_dataset(const std::filesystem::path& file, GdalMessages& messages) {
  check_readable(file);
  const std::string path = std::filesystem::absolute(file).string();
  const std::string name = height_format(path);
  // GDAL's ASCII driver would guess the type from the first 100 KB.
  const char* const ascii[] = {"DATATYPE=Float64", nullptr};
  messages.clear();
  if (name.empty() && begins_with_order_mark(file))
    throw InputError(file,
                     fmt::format("begins with a byte order mark, which GDAL can't read; remove it "
                                 "with: sed -i '1s/^\\xEF\\xBB\\xBF//' {}",
                                 shell_quoted(file)));
  if (name.empty()) {
    throw InputError(file,
                     "is not a raster format for terrain; use a GeoTIFF or an Esri ASCII grid of "
                     "heights, or convert it with: " +
                         translate_command(file, "", "_geotiff"));
  }
  const char* const formats[] = {name.c_str(), nullptr};
  GdalDataset dataset(gdal().GDALOpenEx(
      path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR, formats,
      name == "AAIGrid" || name == "GRASSASCIIGrid" ? ascii : nullptr, nullptr));
  if (dataset) return dataset;
  throw InputError(file, fmt::format("is damaged ({})", messages.error_or("GDAL can't open it")));
}

void check_is_heights(const std::filesystem::path& file, const GdalDataset& dataset) {
  if (gdal().GDALGetRasterCount(dataset.get()) < 1)
    throw InputError(file, "has no band; heights must be in the first band");
  const int nx = gdal().GDALGetRasterXSize(dataset.get());
  const int ny = gdal().GDALGetRasterYSize(dataset.get());
  if (nx < 2 || ny < 2 || double(nx) * ny > kMostPosts) {
    throw InputError(file, fmt::format("has {} x {} cells; 2 x 2 to {:.0e} cells in all would do",
                                       nx, ny, kMostPosts));
  }
  const GDALRasterBandH band = gdal().GDALGetRasterBand(dataset.get(), 1);
  const GDALDataType type = gdal().GDALGetRasterDataType(band);
  int bx = 0, by = 0;
  gdal().GDALGetBlockSize(band, &bx, &by);
  const double block_bytes = double(bx) * by * gdal().GDALGetDataTypeSizeBytes(type);
  const auto file_bytes = static_cast<double>(std::filesystem::file_size(file));
  if (block_bytes > std::max(kLargeBlock_bytes, kMostPacked * file_bytes)) {
    throw InputError(
        file,
        fmt::format("is damaged or has too large blocks, {} x {} cells, of which each is read "
                    "whole; make tiles with: {}",
                    bx, by, translate_command(file, "-co TILED=YES", "_tiled")));
  }
  if (gdal().GDALDataTypeIsComplex(type)) {
    throw InputError(file, "holds complex numbers; heights in metres are needed");
  }
  const GDALColorInterp colour = gdal().GDALGetRasterColorInterpretation(band);
  if (colour == GCI_PaletteIndex || colour == GCI_RedBand) {
    throw InputError(file, "is a picture, its first band a colour; heights in metres are needed");
  }
}

/// GDAL's geotransform: x = t[0] + column t[1] + row t[2], and y likewise.
using GeoTransform = std::array<double, 6>;

GeoTransform require_place(const std::filesystem::path& file, const GdalHeights& source) {
  GeoTransform t;
  if (gdal().GDALGetGeoTransform(source.dataset().get(), t.data()) == CE_None) return t;
  throw InputError(file,
                   "has no position and cell size; set the coordinates of its upper left and lower "
                   "right corner with: " +
                       translate_command(file, "-a_ullr <xmin> <ymax> <xmax> <ymin>", "_placed"));
}

/// Sets the source's direction. @return the posts: the cells' centres
HeightGrid north_up(const RasterAdvice& advice, const GeoTransform& t, GdalHeights& source) {
  const std::filesystem::path& file = advice.file();
  const int nx = source.nx(), ny = source.ny();
  if (!std::all_of(t.begin(), t.end(), [](double v) { return std::abs(v) < 1e12; })) {
    throw InputError(file, "has a position or cell size that is not a number or beyond measure");
  }
  // A rotation that moves all cells by less than a thousandth of their size is rounding.
  if (std::abs(t[2]) * ny > 1e-3 * std::abs(t[1]) || std::abs(t[4]) * nx > 1e-3 * std::abs(t[5])) {
    throw InputError(file, "is rotated; turn it north up with: " + advice.warp("", "_north_up"));
  }
  if (t[1] == 0 || t[5] == 0) throw InputError(file, "has cells of size 0; above 0 m is needed");
  source.set_direction(t[1] < 0, t[5] < 0);
  HeightGrid grid;
  grid.nx = nx;
  grid.ny = ny;
  grid.spacing = {std::abs(t[1]), std::abs(t[5])};
  grid.first = {std::min(t[0], t[0] + nx * t[1]) + grid.spacing.x() / 2,
                std::min(t[3], t[3] + ny * t[5]) + grid.spacing.y() / 2};
  return grid;
}

/// Finds a truncated GeoTIFF by blocks beyond its end, without reading them.
void check_blocks_within_file(const std::filesystem::path& file, GdalHeights& source) {
  int bx = 0, by = 0;
  gdal().GDALGetBlockSize(source.band(), &bx, &by);
  if (bx < 1 || by < 1) return;
  const std::int64_t columns = (source.nx() + bx - 1) / bx, rows = (source.ny() + by - 1) / by;
  constexpr std::int64_t kMost = 10'000;
  const std::int64_t step = std::max<std::int64_t>(1, columns * rows / kMost);
  const auto size = static_cast<double>(std::filesystem::file_size(file));
  for (std::int64_t last = columns * rows - 1, n = last; n >= 0; n -= step) {
    const auto item = [&](const char* name) {
      const std::string key = fmt::format("{}_{}_{}", name, n % columns, n / columns);
      const char* text = gdal().GDALGetMetadataItem(source.band(), key.c_str(), "TIFF");
      return text != nullptr ? parse_number(text).value_or(0) : 0;
    };
    if (item("BLOCK_OFFSET") + item("BLOCK_SIZE") > size) {
      throw InputError(file, "is damaged: it ends before its data do; copy or download it again");
    }
  }
}

/// Reads a small raster completely, and a few blocks of a large one.
Probe probe(const std::filesystem::path& file, GdalHeights& source, const std::string& driver) {
  const std::int64_t nx = source.nx(), ny = source.ny();
  const std::uintmax_t bytes = std::filesystem::file_size(file);
  const bool ascii = driver == "AAIGrid" || driver == "GRASSASCIIGrid" || driver == "GSAG";
  if (driver == "GTiff") check_blocks_within_file(file, source);
  if (ascii && bytes < 2 * static_cast<std::uintmax_t>(nx * ny)) {
    throw InputError(file,
                     fmt::format("is damaged: {} bytes can't hold {} x {} heights", bytes, nx, ny));
  }
  Probe result;
  std::vector<float> heights;
  const std::vector<float> doubtful = source.doubtful();
  const auto look = [&](std::int64_t x, std::int64_t y, std::int64_t w, std::int64_t h) {
    heights.resize(static_cast<std::size_t>(w * h));
    source.read(int(x), int(y), int(w), int(h), heights.data());
    for (const float z : heights) {
      if (std::isnan(z)) continue;
      result.low = std::min<double>(result.low, z);
      result.high = std::max<double>(result.high, z);
      if (std::find(doubtful.begin(), doubtful.end(), z) != doubtful.end()) result.doubtful = z;
    }
  };
  if (nx * ny <= kReadWhole && bytes <= kReadWholeBytes) {
    look(0, 0, nx, ny);
    result.whole = true;
    return result;
  }
  int bx = 0, by = 0;
  gdal().GDALGetBlockSize(source.band(), &bx, &by);
  // Skips blocks that are too large, and formats that must be read from the start.
  if (ascii || std::int64_t{bx} * by > kReadWhole) return result;
  for (const std::int64_t y : {std::int64_t{0}, ny / 2, ny - 1}) {
    for (const std::int64_t x : {std::int64_t{0}, nx / 2, nx - 1}) look(x, y, 1, 1);
  }
  return result;
}

/// Refuses a raster without a CRS that is probably in degrees: cells below a centimetre, and ground
/// higher than wide.
void refuse_likely_degrees(const RasterAdvice& advice, const HeightGrid& grid, const Probe& seen) {
  const Vec2 size = grid.spacing.cwiseProduct(Vec2(grid.nx, grid.ny));
  const Vec2 centre = grid.first + size / 2,
             far = grid.first.cwiseAbs().cwiseMax((grid.first + size).cwiseAbs());
  if (far.x() > 361 || far.y() > 91 || grid.spacing.maxCoeff() > 0.01) return;
  if (!(seen.high - seen.low > size.maxCoeff())) return;
  throw InputError(
      advice.file(),
      fmt::format("has no CRS and looks to be in degrees (cells of {:g}, heights from {:g} to "
                  "{:g} m); reproject it with: {}",
                  grid.spacing.x(), seen.low, seen.high,
                  advice.reproject(utm_epsg(centre.x(), centre.y()), "EPSG:4326")));
}

/// Warns of 8-bit pictures, which can pass as rasters of heights.
void warn_of_greys(const std::filesystem::path& file, const GdalHeights& source,
                   std::vector<std::string>& warnings) {
  const GDALColorInterp colour = gdal().GDALGetRasterColorInterpretation(source.band());
  if (gdal().GDALGetRasterDataType(source.band()) != GDT_Byte || source.packed() ||
      (colour != GCI_GrayIndex && colour != GCI_Undefined))
    return;
  warnings.push_back(fmt::format(
      "{}: has 8-bit greys from 0 to 255, like a picture; they are taken as heights in metres",
      file.string()));
}

}  // namespace

RasterInput open_raster(const std::filesystem::path& file) {
  if (is_tin(file)) return open_tin(file);
  GdalMessages messages;
  auto source = std::make_shared<GdalHeights>(file, open_dataset(file, messages));
  check_is_heights(file, source->dataset());
  RasterInput input;
  input.driver = driver_of(source->dataset());
  const RasterAdvice advice(file, [&](double metres) { return source->kept(metres); });
  Srs srs = gdal().GDALGetSpatialRef(source->dataset().get());
  if (srs != nullptr) input.crs_wkt = wkt_of(srs);
  if (input.crs_wkt.empty()) srs = nullptr;
  const char* unit_type = gdal().GDALGetRasterUnitType(source->band());
  const std::string unit = unit_type != nullptr ? unit_type : "";
  const GeoTransform t = require_place(file, *source);
  const double columns = source->nx() / 2.0, rows = source->ny() / 2.0;
  const Vec2 centre(t[0] + columns * t[1] + rows * t[2], t[3] + columns * t[4] + rows * t[5]);
  input.warnings = require_metre_heights(advice, srs, centre, unit);
  input.grid = north_up(advice, t, *source);
  if (srs != nullptr) require_metres(advice, srs, centre, unit);
  Probe seen;
  try {
    seen = probe(file, *source, input.driver);
  } catch (const InputError&) {
    throw;
  } catch (const std::runtime_error& error) {  // its message names the file
    throw InputError(error.what());
  }
  if (seen.whole && seen.low > seen.high) {
    throw InputError(file, "has no height: all its cells are NODATA or beyond +-100 km");
  }
  if (input.crs_wkt.empty()) refuse_likely_degrees(advice, input.grid, seen);
  if (!names_height_unit(srs, unit)) warn_of_greys(file, *source, input.warnings);
  if (seen.doubtful)
    input.warnings.push_back(fmt::format(
        "{}: has heights of {:g} m, which may be voids; if so, declare them as its NODATA",
        file.string(), *seen.doubtful));
  input.source = std::move(source);
  return input;
}

}  // namespace soilvdb::inline v0::io
