// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// GDAL by its C interface, loaded at its first use: GDAL and its hundred libraries would take half
// of the program's start. Its messages do not reach the terminal.
#pragma once

#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_vsi.h>
#include <gdal.h>
#include <ogr_api.h>
#include <ogr_srs_api.h>

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "io/file/shared_library.h"

namespace soilvdb::inline v0::io {

/// The functions of GDAL in use.
struct GdalFunctions {
  /// Sets GDAL up for height files.
  GdalFunctions();

  const SharedLibrary library;
  SOILVDB_FUNCTIONS(
      CPLErrorReset, CPLGetErrorHandlerUserData, CPLPopErrorHandler, CPLPushErrorHandlerEx,
      CPLSetThreadLocalConfigOption, GDALClose, GDALCreate, GDALDataTypeIsComplex, GDALGetBlockSize,
      GDALGetDataTypeName, GDALGetDataTypeSizeBytes, GDALGetDatasetDriver, GDALGetDriverByName,
      GDALGetDriverShortName, GDALGetGeoTransform, GDALGetMaskBand, GDALGetMaskFlags,
      GDALGetMetadataItem, GDALGetProjectionRef, GDALGetRasterBand,
      GDALGetRasterColorInterpretation, GDALGetRasterCount, GDALGetRasterDataType,
      GDALGetRasterNoDataValue, GDALGetRasterOffset, GDALGetRasterScale, GDALGetRasterUnitType,
      GDALGetRasterXSize, GDALGetRasterYSize, GDALGetSpatialRef, GDALIdentifyDriverEx, GDALOpenEx,
      GDALRasterIO, GDALSetDescription, GDALSetGeoTransform, GDALSetRasterNoDataValue,
      GDALSetRasterUnitType, GDALSetSpatialRef, OCTDestroyCoordinateTransformation,
      OCTNewCoordinateTransformation, OCTTransform, OSRClone, OSRDemoteTo2D,
      OSRDestroySpatialReference, OSRExportToWktEx, OSRGetAuthorityCode, OSRGetAuthorityName,
      OSRGetAxesCount, OSRGetLinearUnits, OSRGetName, OSRGetTargetLinearUnits, OSRImportFromEPSG,
      OSRIsCompound, OSRIsDerivedGeographic, OSRIsGeocentric, OSRIsGeographic, OSRIsProjected,
      OSRSetCompoundCS, OSRSetFromUserInput, OSRSetLinearUnitsAndUpdateParameters, OSRSetProjCS,
      GDALDatasetGetLayer, GDALDatasetGetLayerCount, OGR_F_Destroy, OGR_F_GetFieldAsString,
      OGR_F_GetFieldIndex, OGR_F_GetGeometryRef, OGR_G_GetGeometryCount, OGR_G_DestroyGeometry,
      OGR_G_GetGeometryRef, OGR_G_GetGeometryType, OGR_G_GetLinearGeometry, OGR_G_GetPoint,
      OGR_G_GetPointCount, OGR_L_GetNextFeature, OGR_L_GetSpatialRef, OGR_G_Is3D, OGR_GT_Flatten,
      OSRIsSameEx, OSRNewSpatialReference, OSRSetAxisMappingStrategy, OSRStripVertical, VSIFCloseL,
      VSIFileFromMemBuffer, VSIFree, VSIGetMemFileBuffer, VSIUnlink);
};

/// Loads GDAL at the first call.
/// @throw std::runtime_error if it can't be loaded
const GdalFunctions& gdal();

struct GdalClose {
  void operator()(void* dataset) const { gdal().GDALClose(dataset); }
};
/// A GDALDatasetH.
using GdalDataset = std::unique_ptr<void, GdalClose>;

struct DestroySrs {
  void operator()(void* srs) const { gdal().OSRDestroySpatialReference(srs); }
};
/// An OGRSpatialReferenceH.
using OwnSrs = std::unique_ptr<void, DestroySrs>;

/// A CRS by its text; null if the text is not a CRS.
OwnSrs srs_of(const std::string& wkt);
/// A CRS of x and y alone, x to the east.
OwnSrs horizontal_of(OGRSpatialReferenceH srs);

struct DestroyTransform {
  void operator()(void* transform) const { gdal().OCTDestroyCoordinateTransformation(transform); }
};
/// An OGRCoordinateTransformationH.
using Transform = std::unique_ptr<void, DestroyTransform>;

struct DestroyFeature {
  void operator()(void* feature) const { gdal().OGR_F_Destroy(feature); }
};
/// An OGRFeatureH.
using Feature = std::unique_ptr<void, DestroyFeature>;

/// GDAL's name of a format.
std::string driver_of(const GdalDataset& dataset);

/// GDAL's name of a height file's format; empty if it has no supported format, even if another part
/// of the process registered more drivers. Formats whose files have no signature (EHdr, ENVI) are
/// tried last, because they take any file beside a header of theirs.
std::string height_format(const std::filesystem::path& file);

/// A file in GDAL's memory, removed by its destructor.
class MemoryFile {
 public:
  explicit MemoryFile(const std::string& suffix);
  ~MemoryFile();
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  const char* path() const { return path_.c_str(); }
  /// @param text must live as long as the file
  void hold(std::string& text) const;
  std::string_view bytes() const;

 private:
  std::string path_;
};

/// Collects messages of GDAL and PROJ on this thread during its lifetime. Scopes nest.
class GdalMessages {
 public:
  GdalMessages();
  ~GdalMessages();
  GdalMessages(const GdalMessages&) = delete;
  GdalMessages& operator=(const GdalMessages&) = delete;

  /// The first error so far, on one line; empty without errors.
  const std::string& error() const { return error_; }
  /// The first error, or `otherwise` if GDAL gave none.
  std::string error_or(const char* otherwise) const;
  void clear() { error_.clear(); }

 private:
  static void keep(int severity, int number, const char* message);
  std::string error_;
};

}  // namespace soilvdb::inline v0::io
