// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/gdal_heights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "io/terrain/gdal.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
constexpr double kHighest = 1e5;  // m, either way

}  // namespace

GdalHeights::GdalHeights(std::filesystem::path file, GdalDataset dataset)
    : file_(std::move(file)),
      dataset_(std::move(dataset)),
      band_(gdal().GDALGetRasterBand(dataset_.get(), 1)),
      nx_(gdal().GDALGetRasterXSize(dataset_.get())),
      ny_(gdal().GDALGetRasterYSize(dataset_.get())) {
  if ((gdal().GDALGetMaskFlags(band_) & GMF_ALL_VALID) == 0) mask_ = gdal().GDALGetMaskBand(band_);
  int given = 0;
  const double scale = gdal().GDALGetRasterScale(band_, &given);
  if (given && std::isfinite(scale) && scale != 0) scale_ = scale;
  const double offset = gdal().GDALGetRasterOffset(band_, &given);
  if (given && std::isfinite(offset)) offset_ = offset;
  const double nodata = gdal().GDALGetRasterNoDataValue(band_, &given);
  if (given) nodata_ = nodata;
}

KeptHeights GdalHeights::kept(double metres) const {
  const int flags = gdal().GDALGetMaskFlags(band_);
  KeptHeights kept;
  kept.scale = scale_;
  kept.offset = offset_;
  kept.wide = gdal().GDALGetRasterDataType(band_) == GDT_Float64;
  kept.nodata = nodata_.has_value();
  kept.masked = mask_ != nullptr && (flags & GMF_NODATA) == 0;
  if (kept.masked && (flags & GMF_ALPHA) != 0) kept.alpha_band = alpha_band();
  if (!kept.nodata && !kept.masked) kept.unnamed_voids = find_voids(metres);
  return kept;
}

/// The alpha band's number. GDAL makes no mask of an alpha band that does not have eight bits.
int GdalHeights::alpha_band() const {
  for (int band = gdal().GDALGetRasterCount(dataset_.get()); band > 1; --band)
    if (gdal().GDALGetRasterColorInterpretation(gdal().GDALGetRasterBand(dataset_.get(), band)) ==
        GCI_AlphaBand)
      return band;
  return 0;
}

std::vector<float> GdalHeights::doubtful() const {
  std::vector<float> all;
  for (const float none : kVoids) {
    if (nodata_)
      all.push_back(none);
    else if (packed())
      all.push_back(static_cast<float>(none * scale_ + offset_));
  }
  return all;
}

void GdalHeights::read(int x0, int y0, int w, int h, float* out) const {
  const std::lock_guard lock(mutex_);
  const GdalMessages messages;
  const int column = westward_ ? nx() - x0 - w : x0, row = southward_ ? ny() - y0 - h : y0;
  const std::size_t size = std::size_t(w) * h;
  std::vector<double> raw(size);
  std::vector<std::uint8_t> valid(mask_ != nullptr ? size : 0);
  const auto fill = [&](GDALRasterBandH from, void* to, GDALDataType type) {
    return gdal().GDALRasterIO(from, GF_Read, column, row, w, h, to, w, h, type, 0, 0) == CE_None;
  };
  if (!fill(band_, raw.data(), GDT_Float64) ||
      (mask_ != nullptr && !fill(mask_, valid.data(), GDT_Byte))) {
    throw std::runtime_error(fmt::format(
        "{}: is damaged: rows {} to {}, columns {} to {} can't be read ({})", file_.string(), row,
        row + h - 1, column, column + w - 1, messages.error_or("GDAL gives no reason")));
  }
  for (int j = 0; j < h; ++j) {
    for (int i = 0; i < w; ++i) {
      const std::size_t from =
          std::size_t(southward_ ? h - 1 - j : j) * w + (westward_ ? w - 1 - i : i);
      const bool there = valid.empty() || valid[from] != 0;
      out[std::size_t(j) * w + i] = there ? height(raw[from]) : kNone;
    }
  }
}

float GdalHeights::height(double raw) const {
  if (nodata_ && raw == *nodata_) return kNone;  // also if a mask hides NODATA from GDAL
  const auto z = static_cast<float>(raw * scale_ + offset_);
  return is_void(z, 1) ? kNone : z;
}

/// Is a number other than NODATA a void? @param metres length of its unit
bool GdalHeights::is_void(float z, double metres) const {
  if (!nodata_ && std::find(std::begin(kVoids), std::end(kVoids), z) != std::end(kVoids))
    return true;
  return !(std::abs(z) * metres <= kHighest);
}

/// Stored values of unnamed voids, in all of a small raster, and in evenly spread windows of a
/// large one.
std::vector<double> GdalHeights::find_voids(double metres) const {
  const std::lock_guard lock(mutex_);
  const GdalMessages messages;
  constexpr int kSide = 64, kWindows = 16;
  constexpr std::size_t kMost = 8;  // no file marks voids by more values
  const bool whole = std::int64_t{nx()} * ny() <= kReadWhole;
  const int w = whole ? nx() : std::min(nx(), kSide), h = whole ? ny() : std::min(ny(), kSide);
  std::vector<double> raw(std::size_t(w) * h), voids;
  for (std::int64_t i = 0; i < (whole ? 1 : kWindows * kWindows); ++i) {
    const auto x = static_cast<int>((nx() - w) * (i % kWindows) / (kWindows - 1));
    const auto y = static_cast<int>((ny() - h) * (i / kWindows) / (kWindows - 1));
    if (gdal().GDALRasterIO(band_, GF_Read, x, y, w, h, raw.data(), w, h, GDT_Float64, 0, 0) !=
        CE_None)
      break;  // damage is reported when it is read
    for (const double value : raw) {
      const auto z = static_cast<float>(value * scale_ + offset_);
      if (std::isfinite(value) && is_void(z, metres) && voids.size() < kMost &&
          std::find(voids.begin(), voids.end(), value) == voids.end())
        voids.push_back(value);
    }
  }
  return voids;
}

}  // namespace soilvdb::inline v0::io
