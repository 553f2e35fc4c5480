// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// GDAL, by its C interface. It is loaded when it is first needed, since it and the hundred
// libraries that it needs would take half of a start of the program; its messages are kept from the
// terminal.
#pragma once

#include <cpl_error.h>
#include <cpl_vsi.h>
#include <gdal.h>
#include <ogr_srs_api.h>

#include <filesystem>
#include <memory>
#include <string>

namespace soilvdb::inline v0::io {

// clang-format off
#define SOILVDB_GDAL_FUNCTIONS(F)                                                                  \
  F(CPLErrorReset) F(CPLGetErrorHandlerUserData) F(CPLPopErrorHandler) F(CPLPushErrorHandlerEx)    \
  F(GDALClose) F(GDALCreate) F(GDALDataTypeIsComplex) F(GDALGetBlockSize)                          \
  F(GDALGetDataTypeName) F(GDALGetDataTypeSizeBytes) F(GDALGetDatasetDriver)                       \
  F(GDALGetDriverByName) F(GDALGetDriverShortName) F(GDALGetGeoTransform) F(GDALGetMaskBand)       \
  F(GDALGetMaskFlags) F(GDALGetMetadataItem) F(GDALGetProjectionRef) F(GDALGetRasterBand)          \
  F(GDALGetRasterColorInterpretation) F(GDALGetRasterCount) F(GDALGetRasterDataType)               \
  F(GDALGetRasterNoDataValue) F(GDALGetRasterOffset) F(GDALGetRasterScale)                         \
  F(GDALGetRasterUnitType) F(GDALGetRasterXSize) F(GDALGetRasterYSize) F(GDALGetSpatialRef)        \
  F(GDALIdentifyDriverEx) F(GDALOpenEx) F(GDALRasterIO) F(GDALSetDescription)                      \
  F(GDALSetGeoTransform) F(GDALSetRasterNoDataValue) F(GDALSetRasterUnitType)                      \
  F(GDALSetSpatialRef) F(OCTDestroyCoordinateTransformation) F(OCTNewCoordinateTransformation)     \
  F(OCTTransform) F(OSRClone) F(OSRDemoteTo2D) F(OSRDestroySpatialReference)                       \
  F(OSRExportToWktEx) F(OSRGetAuthorityCode) F(OSRGetAuthorityName) F(OSRGetAxesCount)             \
  F(OSRGetLinearUnits) F(OSRGetName) F(OSRGetTargetLinearUnits) F(OSRImportFromEPSG)               \
  F(OSRIsCompound) F(OSRIsDerivedGeographic) F(OSRIsGeocentric) F(OSRIsGeographic)                 \
  F(OSRIsSameEx) F(OSRNewSpatialReference) F(OSRSetAxisMappingStrategy) F(OSRStripVertical)        \
  F(VSIFree) F(VSIGetMemFileBuffer) F(VSIUnlink)
// clang-format on

/// The functions of GDAL that we call, each by its own name.
struct GdalFunctions {
#define SOILVDB_GDAL_FUNCTION(name) decltype(&::name) name;
  SOILVDB_GDAL_FUNCTIONS(SOILVDB_GDAL_FUNCTION)
#undef SOILVDB_GDAL_FUNCTION
};

/// Loads GDAL at the first call, and makes it ready for files of heights.
/// @throw std::runtime_error if it can't be loaded
const GdalFunctions& gdal();

struct GdalClose {
  void operator()(void* dataset) const { gdal().GDALClose(dataset); }
};
/// What it points to is a GDALDatasetH.
using GdalDataset = std::unique_ptr<void, GdalClose>;

struct DestroySrs {
  void operator()(void* srs) const { gdal().OSRDestroySpatialReference(srs); }
};
/// What it points to is an OGRSpatialReferenceH.
using OwnSrs = std::unique_ptr<void, DestroySrs>;

/// A CRS by its text; null if it is no CRS's.
OwnSrs srs_of(const std::string& wkt);

/// A format's name, as GDAL has it.
std::string driver_of(const GdalDataset& dataset);

/// The format of a file of heights, by GDAL's name; empty: of none that we read, whatever others
/// have told GDAL of. Formats whose files say nothing of themselves (EHdr, ENVI) are asked last:
/// they take any file with a header of theirs beside it.
std::string height_format(const std::filesystem::path& file);

/// While one lives, what GDAL and PROJ would print on this thread is kept here. Scopes nest.
class GdalMessages {
 public:
  GdalMessages();
  ~GdalMessages();
  GdalMessages(const GdalMessages&) = delete;
  GdalMessages& operator=(const GdalMessages&) = delete;

  /// The first error so far, on one line; empty if there was none.
  const std::string& error() const { return error_; }
  /// The first error, or `otherwise` if GDAL failed without a word.
  std::string error_or(const char* otherwise) const;
  void clear() { error_.clear(); }

 private:
  static void keep(int severity, int number, const char* message);
  std::string error_;
};

}  // namespace soilvdb::inline v0::io
