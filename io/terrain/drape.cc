// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/drape.h"

#include <fmt/format.h>
#include <gdal_utils.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "core/tool/polygon.h"
#include "io/file/shared_library.h"
#include "io/file/text.h"
#include "io/terrain/crs.h"
#include "io/terrain/gdal.h"
#include "io/terrain/raster_advice.h"
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kMostPixels = 1 << 22;  // 16 MB of a graphics card, 5 MB more with its mipmaps
constexpr int kMostSide = 4096;          // of textures that every browser can have
constexpr std::size_t kMostWebp_bytes = 4 << 20;
constexpr const char* kQuality = "QUALITY=80";
constexpr int kAlongSide = 20;  // points of each border that are transformed

/// Formats of pictures, which are built into GDAL.
constexpr std::array<const char*, 8> kPictures = {"GTiff",       "JPEG", "PNG", "WEBP",
                                                  "JP2OpenJPEG", "HFA",  "BMP", "GIF"};

/// More functions of GDAL, which only drapes need.
struct DrapeFunctions {
  const SharedLibrary& library = gdal().library;
  SOILVDB_FUNCTIONS(GDALCreateCopy, GDALGetColorEntryAsRGB, GDALGetGCPCount,
                    GDALGetRasterColorTable, GDALWarp, GDALWarpAppOptionsFree,
                    GDALWarpAppOptionsNew);

  DrapeFunctions() {
    for (const char* format : kPictures)
      library.function<void (*)()>(std::string("GDALRegister_") + format)();
    library.function<void (*)()>("GDALRegister_MEM")();
  }
};

const DrapeFunctions& drape_gdal() {
  static const DrapeFunctions functions;
  return functions;
}

/// Bands of a raster of colours: red, green and blue, or one of greys or of a palette.
struct DrapeColours {
  std::array<int, 3> bands = {1, 1, 1};
  GDALColorTableH palette = nullptr;
  int brightest = 255;  ///< of bands without a palette
};

DrapeColours colours_of(const std::filesystem::path& file, const GdalDataset& dataset) {
  const int count = gdal().GDALGetRasterCount(dataset.get());
  if (count < 1) throw InputError(file, "has no band; a drape has bands of red, green and blue");
  DrapeColours colours;
  std::array<int, 3> found = {};
  for (int i = 1; i <= count; ++i) {
    const int colour =
        gdal().GDALGetRasterColorInterpretation(gdal().GDALGetRasterBand(dataset.get(), i));
    for (int c = 0; c < 3; ++c)
      if (colour == GCI_RedBand + c && found[static_cast<std::size_t>(c)] == 0)
        found[static_cast<std::size_t>(c)] = i;
  }
  if (std::all_of(found.begin(), found.end(), [](int band) { return band > 0; }))
    colours.bands = found;
  else if (count >= 3)
    colours.bands = {1, 2, 3};
  for (const int i : colours.bands) {
    const GDALRasterBandH band = gdal().GDALGetRasterBand(dataset.get(), i);
    const GDALDataType type = gdal().GDALGetRasterDataType(band);
    if (type == GDT_Byte) {
      if (const char* bits = gdal().GDALGetMetadataItem(band, "NBITS", "IMAGE_STRUCTURE"))
        colours.brightest = (1 << std::clamp(parsed<int>(bits).value_or(8), 1, 8)) - 1;
      continue;
    }
    if (type == GDT_UInt16 && count >= 3)
      throw InputError(file, "has colours of 16 bits; make 8 bits of them with: " +
                                 translate_command(file, "-ot Byte -scale", "_8bit"));
    throw InputError(file,
                     fmt::format("holds heights or other numbers ({}), not colours; a drape is an "
                                 "orthophoto or map with red, green and blue of 8 bits",
                                 gdal().GDALGetDataTypeName(type)));
  }
  if (count < 3)
    colours.palette = drape_gdal().GDALGetRasterColorTable(
        gdal().GDALGetRasterBand(dataset.get(), colours.bands[0]));
  return colours;
}

/// CRSs of a file and of its site, without heights; null if they are taken as the same.
struct DrapeCrs {
  OwnSrs from, to;
};

DrapeCrs crs_of(const std::filesystem::path& file, const GdalDataset& dataset,
                const std::string& crs_wkt, bool plane, std::vector<std::string>& warnings) {
  Srs own = gdal().GDALGetSpatialRef(dataset.get());
  const OwnSrs site = srs_of(crs_wkt);
  const bool named = own != nullptr && !wkt_of(own).empty();
  if (named && site) return {horizontal_of(own), horizontal_of(site.get())};
  if (site)
    throw InputError(
        file,
        fmt::format("names no CRS, and the site is in {}; if its coordinates "
                    "are, too, say so with: {}",
                    crs_label(crs_wkt),
                    translate_command(file, "-a_srs " + shell_quoted(crs_label(crs_wkt)), "_crs")));
  if (named && !plane)
    throw InputError(file, fmt::format("is in {}, and the site's terrain names no CRS; if it is "
                                       "in the same, say so in the terrain's file, with "
                                       "gdal_translate -a_srs",
                                       crs_label(wkt_of(own))));
  if (named)
    warnings.push_back(fmt::format("{}: is in {}, and the site names no CRS; the same is assumed",
                                   file.string(), crs_label(wkt_of(own))));
  return {};
}

/// The box of a raster in the site's CRS, and the mean side of its cells there.
struct DrapeExtent {
  Eigen::AlignedBox2d box;
  double cell_m = 0;
};

DrapeExtent extent_of(const std::filesystem::path& file, const GdalDataset& dataset,
                      const DrapeCrs& crs) {
  std::array<double, 6> t{};
  if (gdal().GDALGetGeoTransform(dataset.get(), t.data()) != CE_None)
    throw InputError(
        file,
        drape_gdal().GDALGetGCPCount(dataset.get()) > 0
            ? "is placed by control points only; make an orthophoto of it with gdalwarp"
            : "has no georeference; set the coordinates of its upper left and lower right corner "
              "with: " +
                  translate_command(file, "-a_srs <CRS> -a_ullr <xmin> <ymax> <xmax> <ymin>",
                                    "_placed"));
  const double nx = gdal().GDALGetRasterXSize(dataset.get()),
               ny = gdal().GDALGetRasterYSize(dataset.get());
  const Transform transform(
      crs.from ? gdal().OCTNewCoordinateTransformation(crs.from.get(), crs.to.get()) : nullptr);
  const GdalMessages quiet;
  DrapeExtent extent;
  std::vector<Vec2> around;
  for (int side = 0; side < 4; ++side) {
    for (int k = 0; k < kAlongSide; ++k) {
      const double along = static_cast<double>(k) / kAlongSide;
      const std::array<Vec2, 4> at = {Vec2(along, 0), {1, along}, {1 - along, 1}, {0, 1 - along}};
      const Vec2 cell = at[static_cast<std::size_t>(side)].cwiseProduct(Vec2(nx, ny));
      double x = t[0] + cell.x() * t[1] + cell.y() * t[2], z = 0;
      double y = t[3] + cell.x() * t[4] + cell.y() * t[5];
      const bool good =
          !crs.from || (transform && gdal().OCTTransform(transform.get(), 1, &x, &y, &z) != 0);
      if (!good || !std::isfinite(x) || !std::isfinite(y))
        throw InputError(file, "can't be brought into the CRS of the site" +
                                   (quiet.error().empty() ? "" : " (" + quiet.error() + ")"));
      around.emplace_back(x, y);
      extent.box.extend(around.back());
    }
  }
  extent.cell_m = std::sqrt(area_of(around) / (nx * ny));
  if (!(extent.cell_m > 0)) throw InputError(file, "has cells of size 0; above 0 m is needed");
  return extent;
}

std::string place_text(const Eigen::AlignedBox2d& box) {
  return fmt::format("{:.0f}, {:.0f} to {:.0f}, {:.0f}", box.min().x(), box.min().y(),
                     box.max().x(), box.max().y());
}

/// The raster in the site's CRS, with a band of alpha after its own bands.
GdalDataset warped(const std::filesystem::path& file, const GdalDataset& dataset,
                   const DrapeCrs& crs, const DrapeColours& colours, const Drape& drape,
                   GdalMessages& messages) {
  std::vector<std::string> words = {"-of",
                                    "MEM",
                                    "-dstalpha",
                                    "-r",
                                    colours.palette != nullptr ? "near" : "average",
                                    "-te",
                                    fmt::format("{}", drape.box_m.min().x()),
                                    fmt::format("{}", drape.box_m.min().y()),
                                    fmt::format("{}", drape.box_m.max().x()),
                                    fmt::format("{}", drape.box_m.max().y()),
                                    "-ts",
                                    std::to_string(drape.columns),
                                    std::to_string(drape.rows)};
  if (!colours.palette && drape.cell_m < 1.5 * drape.file_cell_m) words[4] = "bilinear";
  if (crs.from)
    words.insert(words.end(), {"-s_srs", wkt_of(crs.from.get()), "-t_srs", wkt_of(crs.to.get())});
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  GDALWarpAppOptions* options = drape_gdal().GDALWarpAppOptionsNew(arguments.data(), nullptr);
  std::array<GDALDatasetH, 1> sources = {dataset.get()};
  int error = 0;
  messages.clear();
  constexpr const char* kCutOff = "GDAL_ERROR_ON_LIBJPEG_WARNING";  // other formats' are errors
  gdal().CPLSetThreadLocalConfigOption(kCutOff, "YES");
  GdalDataset made(options == nullptr
                       ? nullptr
                       : drape_gdal().GDALWarp("", nullptr, 1, sources.data(), options, &error));
  gdal().CPLSetThreadLocalConfigOption(kCutOff, nullptr);
  drape_gdal().GDALWarpAppOptionsFree(options);
  if (!made || error != 0 || !messages.error().empty())
    throw InputError(file, fmt::format("can't be brought into the site's CRS or is damaged ({})",
                                       messages.error_or("GDAL gives no reason")));
  return made;
}

using Channel = std::vector<unsigned char>;

Channel read_band(const GdalDataset& dataset, int band, int columns, int rows) {
  Channel values(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  if (gdal().GDALRasterIO(gdal().GDALGetRasterBand(dataset.get(), band), GF_Read, 0, 0, columns,
                          rows, values.data(), columns, rows, GDT_Byte, 0, 0) != CE_None)
    throw std::runtime_error("a picture in memory can't be read");
  return values;
}

std::string encoded(std::array<Channel, 4> channels, int columns, int rows,
                    const GdalMessages& messages) {
  const GdalDataset picture(gdal().GDALCreate(gdal().GDALGetDriverByName("MEM"), "", columns, rows,
                                              4, GDT_Byte, nullptr));
  bool good = picture != nullptr;
  for (int i = 0; good && i < 4; ++i)
    good = gdal().GDALRasterIO(gdal().GDALGetRasterBand(picture.get(), i + 1), GF_Write, 0, 0,
                               columns, rows, channels[static_cast<std::size_t>(i)].data(), columns,
                               rows, GDT_Byte, 0, 0) == CE_None;
  const MemoryFile memory(".webp");
  const char* const options[] = {kQuality, nullptr};
  if (good)
    good = GdalDataset(drape_gdal().GDALCreateCopy(gdal().GDALGetDriverByName("WEBP"),
                                                   memory.path(), picture.get(), 0, options,
                                                   nullptr, nullptr)) != nullptr;
  if (!good || memory.bytes().empty())
    throw std::runtime_error("GDAL can't write WebP (" + messages.error_or("no reason is given") +
                             ")");
  return std::string(memory.bytes());
}

std::string picture_of(const GdalDataset& warped_raster, const DrapeColours& colours,
                       const Drape& drape, const GdalMessages& messages) {
  const auto band = [&](int i) { return read_band(warped_raster, i, drape.columns, drape.rows); };
  std::array<Channel, 4> channels = {band(colours.bands[0]), band(colours.bands[1]),
                                     band(colours.bands[2]),
                                     band(gdal().GDALGetRasterCount(warped_raster.get()))};
  if (colours.palette != nullptr) {
    for (std::size_t i = 0; i < channels[0].size(); ++i) {
      GDALColorEntry entry{};
      drape_gdal().GDALGetColorEntryAsRGB(colours.palette, channels[0][i], &entry);
      const std::array<short, 3> rgb = {entry.c1, entry.c2, entry.c3};
      for (std::size_t c = 0; c < 3; ++c) channels[c][i] = static_cast<unsigned char>(rgb[c]);
      channels[3][i] = static_cast<unsigned char>(channels[3][i] * entry.c4 / 255);
    }
  } else {
    for (std::size_t c = 0; c < 3; ++c)
      for (unsigned char& value : channels[c])
        value = static_cast<unsigned char>(value * 255 / colours.brightest);
  }
  const auto seen = [](unsigned char alpha) { return alpha > 0; };
  if (std::none_of(channels[3].begin(), channels[3].end(), seen)) return "";
  return encoded(std::move(channels), drape.columns, drape.rows, messages);
}

}  // namespace

Drape open_drape(const std::filesystem::path& file, const std::string& crs_wkt, bool plane,
                 const Eigen::AlignedBox2d& bounds) {
  check_readable(file);
  drape_gdal();
  GdalMessages messages;
  const std::string path = std::filesystem::absolute(file).string();
  std::array<const char*, kPictures.size() + 1> formats = {};
  std::copy(kPictures.begin(), kPictures.end(), formats.begin());
  const GDALDriverH driver =
      gdal().GDALIdentifyDriverEx(path.c_str(), GDAL_OF_RASTER, formats.data(), nullptr);
  if (driver == nullptr)
    throw InputError(file, height_format(path).empty()
                               ? "is no picture that can be draped; use a GeoTIFF, JPEG, PNG, WebP "
                                 "or JPEG 2000, or convert it with: " +
                                     translate_command(file, "", "_geotiff")
                               : "holds heights, not colours; a drape is an orthophoto or map with "
                                 "red, green and blue of 8 bits");
  const GdalDataset dataset(
      gdal().GDALOpenEx(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR,
                        formats.data(), nullptr, nullptr));
  if (!dataset)
    throw InputError(file, fmt::format("is damaged ({})", messages.error_or("GDAL can't open it")));
  const DrapeColours colours = colours_of(file, dataset);
  Drape drape;
  const DrapeCrs crs = crs_of(file, dataset, crs_wkt, plane, drape.warnings);
  const DrapeExtent extent = extent_of(file, dataset, crs);
  const bool bounded = !bounds.isEmpty() && bounds.min().allFinite() && bounds.max().allFinite();
  drape.box_m = bounded ? extent.box.intersection(bounds) : extent.box;
  const auto refuse_place = [&] {
    throw InputError(file, fmt::format("is not on the site: it goes from {}, and the site from {}",
                                       place_text(extent.box), place_text(bounds)));
  };
  if (drape.box_m.isEmpty() || drape.box_m.sizes().minCoeff() <= 0) refuse_place();
  drape.file_cell_m = extent.cell_m;
  const Vec2 size = drape.box_m.sizes();
  drape.cell_m =
      std::max({extent.cell_m, std::sqrt(size.prod() / kMostPixels), size.maxCoeff() / kMostSide});
  for (;; drape.cell_m *= std::sqrt(2.0)) {
    const auto cells = [&](double side_m) {
      return std::clamp(static_cast<int>(std::ceil(side_m / drape.cell_m - 1e-6)), 1, kMostSide);
    };
    drape.columns = cells(size.x());
    drape.rows = cells(size.y());
    const GdalDataset made = warped(file, dataset, crs, colours, drape, messages);
    drape.webp = picture_of(made, colours, drape, messages);
    if (drape.webp.empty()) refuse_place();
    if (drape.webp.size() <= kMostWebp_bytes) return drape;
  }
}

}  // namespace soilvdb::inline v0::io
