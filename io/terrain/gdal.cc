// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/gdal.h"

#include <cpl_error.h>
#include <gdal.h>
#include <gdal_frmts.h>

#include <algorithm>
#include <mutex>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

/// The formats of heights, all of them built into GDAL. The other two hundred, and what is in
/// plugins, never get to see a file.
void register_drivers() {
  for (const auto add :
       {GDALRegister_GTiff, GDALRegister_AAIGrid, GDALRegister_AIGrid, GDALRegister_GRASSASCIIGrid,
        GDALRegister_EHdr, GDALRegister_ENVI, GDALRegister_HFA, GDALRegister_GSAG,
        GDALRegister_GSBG, GDALRegister_GS7BG, GDALRegister_SAGA, GDALRegister_SRTMHGT,
        GDALRegister_DTED, GDALRegister_USGSDEM}) {
    add();
  }
}

}  // namespace

std::string height_format(const std::filesystem::path& file) {
  static constexpr const char* kMarked[] = {
      "GTiff", "AAIGrid", "AIG",     "GRASSASCIIGrid", "HFA",     "GSAG", "GSBG",
      "GS7BG", "SAGA",    "SRTMHGT", "DTED",           "USGSDEM", nullptr};
  static constexpr const char* kRaw[] = {"EHdr", "ENVI", nullptr};
  for (const char* const* formats : {kMarked, kRaw}) {
    if (GDALDriverH found = GDALIdentifyDriverEx(file.c_str(), GDAL_OF_RASTER, formats, nullptr))
      return GDALGetDriverShortName(found);
  }
  return "";
}

GdalMessages::GdalMessages() {
  static std::once_flag once;
  std::call_once(once, register_drivers);
  CPLPushErrorHandlerEx([](CPLErr severity, CPLErrorNum number,
                           const char* message) { keep(severity, number, message); },
                        this);
}

GdalMessages::~GdalMessages() {
  CPLPopErrorHandler();
  CPLErrorReset();
}

void GdalMessages::keep(int severity, int, const char* message) {
  auto* self = static_cast<GdalMessages*>(CPLGetErrorHandlerUserData());
  if (severity >= CE_Failure && self->error_.empty()) self->error_ = printable(message);
}

std::string GdalMessages::error_or(const char* otherwise) const {
  return error_.empty() ? otherwise : error_;
}

}  // namespace soilvdb::inline v0::io
