// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// An orthophoto or map as one picture in a site's CRS, small enough for a browser.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

struct Drape {
  std::string webp;                    ///< transparent where the file has no colour
  Eigen::AlignedBox2d box_m;           ///< of the picture, in the site's CRS
  int columns = 0, rows = 0;           ///< row 0 is in the north
  double cell_m = 0, file_cell_m = 0;  ///< sides of its cells, and of the file's in the site's CRS
  std::vector<std::string> warnings = {};
};

/// Resamples the part of a raster of colours that lies on a site.
/// @param crs_wkt of the site; empty: unknown
/// @param plane the site's terrain is a plane, which can't name a CRS: the raster's is taken
/// @param bounds of the site; empty or infinite: all of the raster is kept
/// @throw InputError
Drape open_drape(const std::filesystem::path& file, const std::string& crs_wkt, bool plane,
                 const Eigen::AlignedBox2d& bounds);

}  // namespace soilvdb::inline v0::io
