// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Commands of GDAL's programs that make a usable raster and keep its heights.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace soilvdb::inline v0::io {

/// How a raster stores heights and marks cells without a height.
struct KeptHeights {
  double scale = 1, offset = 0;       ///< height = stored value * scale + offset
  bool wide = false;                  ///< 64-bit floats
  bool nodata = false;                ///< it has a NODATA value
  bool masked = false;                ///< it has a mask or an alpha band
  int alpha_band = 0;                 ///< 0: there is no alpha band
  std::vector<double> unnamed_voids;  ///< stored values that are unmarked voids
};

/// Advice on one raster. Each command keeps the file, and makes another one beside it.
class RasterAdvice {
 public:
  using Kept = std::function<KeptHeights(double metres)>;

  /// @param kept called with the length of the heights' unit when advice is needed, because finding
  ///        unnamed voids means reading heights
  RasterAdvice(std::filesystem::path file, Kept kept);

  const std::filesystem::path& file() const { return file_; }

  /// Converts heights to metres. @param metres length of their unit
  /// @param horizontal CRS of the result as gdal_translate takes it; empty: that of the file
  std::string to_metres(double metres, const std::string& horizontal) const;
  /// Advice on the result of to_metres().
  RasterAdvice in_metres() const;
  /// Makes NAME_SUFFIX.tif without heights outside of the file. @param options of gdalwarp
  std::string warp(const std::string& options, const std::string& suffix) const;
  /// Reprojects to a projected CRS in metres. @param source -s_srs, may be empty
  std::string reproject(int epsg, const std::string& source) const;

 private:
  std::filesystem::path file_;
  Kept kept_;
};

/// gdal_translate of a file to NAME_SUFFIX.tif beside it. Masks stay within the file.
/// @param options of gdal_translate, may be empty
std::string translate_command(const std::filesystem::path& file, const std::string& options,
                              const std::string& suffix);

}  // namespace soilvdb::inline v0::io
