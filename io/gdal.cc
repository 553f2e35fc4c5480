// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/gdal.h"

#include <cpl_error.h>
#include <gdal.h>

#include <algorithm>
#include <mutex>

#include "io/text.h"

namespace soilvdb::io {

GdalMessages::GdalMessages() {
  static std::once_flag once;
  std::call_once(once, [] {
    GDALAllRegister();
    // GDAL's own choice is 5 % of the memory; tiles are kept decoded by the height field anyway.
    GDALSetCacheMax64(GIntBig{64} << 20);
  });
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

}  // namespace soilvdb::io
