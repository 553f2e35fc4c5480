// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights of a band in metres, by GDAL: without voids, scale and offset applied.
#pragma once

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <vector>

#include "io/terrain/gdal.h"
#include "io/terrain/raster_advice.h"
#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0::io {

/// Heights by which programs say that there is none.
inline constexpr float kVoids[] = {-9999, -99999, -32768, -32767};
inline constexpr std::int64_t kReadWhole = 1 << 20;  // posts; larger rasters are sampled

/// Heights of the first band. Thread-safe.
class GdalHeights final : public HeightSource {
 public:
  GdalHeights(std::filesystem::path file, GdalDataset dataset);

  const GdalDataset& dataset() const { return dataset_; }
  GDALRasterBandH band() const { return band_; }
  int nx() const { return nx_; }
  int ny() const { return ny_; }
  bool packed() const { return scale_ != 1 || offset_ != 0; }
  /// Reads some of the heights if voids may be unnamed. @param metres length of their unit
  KeptHeights kept(double metres) const;
  /// Accepted heights that may be voids: values that mark voids in other files, where this file
  /// names another NODATA or packs its heights.
  std::vector<float> doubtful() const;
  /// Sets the directions of columns and rows.
  void set_direction(bool westward, bool southward) {
    westward_ = westward;
    southward_ = southward;
  }

  void read(int x0, int y0, int w, int h, float* out) const override;

 private:
  float height(double raw) const;
  bool is_void(float z, double metres) const;
  std::vector<double> find_voids(double metres) const;
  int alpha_band() const;

  std::filesystem::path file_;
  GdalDataset dataset_;
  GDALRasterBandH band_;
  GDALRasterBandH mask_ = nullptr;
  int nx_, ny_;
  double scale_ = 1, offset_ = 0;
  std::optional<double> nodata_;
  bool westward_ = false, southward_ = true;
  mutable std::mutex mutex_;  // a GDAL dataset is not thread-safe
};

}  // namespace soilvdb::inline v0::io
