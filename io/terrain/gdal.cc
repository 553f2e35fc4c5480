// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/gdal.h"

#include <fmt/format.h>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

/// Height formats that are built into GDAL. Its two hundred other drivers, and its plugins, never
/// open a file.
constexpr const char* kDrivers[] = {"GTiff", "AAIGrid", "AIGrid", "GRASSASCIIGrid", "EHdr",
                                    "ENVI",  "HFA",     "GSAG",   "GSBG",           "GS7BG",
                                    "SAGA",  "SRTMHGT", "DTED",   "USGSDEM"};

/// Formats of design surfaces and lines.
constexpr const char* kVectorDrivers[] = {"DXF", "GeoPackage", "GeoJSON", "Shape"};

}  // namespace

GdalFunctions::GdalFunctions() : library(SOILVDB_GDAL_LIBRARY, "GDAL", "rasters") {
  for (const char* driver : kDrivers)
    library.function<void (*)()>(std::string("GDALRegister_") + driver)();
  for (const char* driver : kVectorDrivers)
    library.function<void (*)()>(std::string("RegisterOGR") + driver)();
}

const GdalFunctions& gdal() {
  static const GdalFunctions functions;
  return functions;
}

OwnSrs srs_of(const std::string& wkt) {
  return OwnSrs(wkt.empty() ? nullptr : gdal().OSRNewSpatialReference(wkt.c_str()));
}

OwnSrs horizontal_of(OGRSpatialReferenceH srs) {
  OwnSrs horizontal(gdal().OSRClone(srs));
  gdal().OSRStripVertical(horizontal.get());
  if (gdal().OSRGetAxesCount(horizontal.get()) == 3)
    gdal().OSRDemoteTo2D(horizontal.get(), nullptr);
  gdal().OSRSetAxisMappingStrategy(horizontal.get(), OAMS_TRADITIONAL_GIS_ORDER);
  return horizontal;
}

std::string driver_of(const GdalDataset& dataset) {
  return gdal().GDALGetDriverShortName(gdal().GDALGetDatasetDriver(dataset.get()));
}

std::string height_format(const std::filesystem::path& file) {
  static constexpr const char* kMarked[] = {
      "GTiff", "AAIGrid", "AIG",     "GRASSASCIIGrid", "HFA",     "GSAG", "GSBG",
      "GS7BG", "SAGA",    "SRTMHGT", "DTED",           "USGSDEM", nullptr};
  static constexpr const char* kRaw[] = {"EHdr", "ENVI", nullptr};
  for (const char* const* formats : {kMarked, kRaw}) {
    if (const GDALDriverH found =
            gdal().GDALIdentifyDriverEx(file.c_str(), GDAL_OF_RASTER, formats, nullptr))
      return gdal().GDALGetDriverShortName(found);
  }
  return "";
}

MemoryFile::MemoryFile(const std::string& suffix)
    : path_(fmt::format("/vsimem/soilvdb-{}{}", static_cast<void*>(this), suffix)) {}

MemoryFile::~MemoryFile() { gdal().VSIUnlink(path_.c_str()); }

void MemoryFile::hold(std::string& text) const {
  gdal().VSIFCloseL(gdal().VSIFileFromMemBuffer(path(), reinterpret_cast<GByte*>(text.data()),
                                                text.size(), FALSE));
}

std::string_view MemoryFile::bytes() const {
  vsi_l_offset size = 0;
  const auto* data = gdal().VSIGetMemFileBuffer(path(), &size, FALSE);
  return {reinterpret_cast<const char*>(data),
          data == nullptr ? 0 : static_cast<std::size_t>(size)};
}

GdalMessages::GdalMessages() {
  gdal().CPLPushErrorHandlerEx([](CPLErr severity, CPLErrorNum number,
                                  const char* message) { keep(severity, number, message); },
                               this);
}

GdalMessages::~GdalMessages() {
  gdal().CPLPopErrorHandler();
  gdal().CPLErrorReset();
}

void GdalMessages::keep(int severity, int, const char* message) {
  auto* self = static_cast<GdalMessages*>(gdal().CPLGetErrorHandlerUserData());
  if (severity >= CE_Failure && self->error_.empty()) self->error_ = printable(message);
}

std::string GdalMessages::error_or(const char* otherwise) const {
  return error_.empty() ? otherwise : error_;
}

}  // namespace soilvdb::inline v0::io
