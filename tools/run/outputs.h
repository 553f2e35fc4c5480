// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What several commands write, and the region of the world they write of.
#pragma once

#include <filesystem>
#include <string>

#include "soilvdb/ground.h"

namespace soilvdb::tools {

/// Parses XMIN,YMIN,XMAX,YMAX. @throw io::InputError that says what would be right.
Eigen::AlignedBox2d parse_region(const std::string& text);

/// A cell of `cell_m`, or the next of 1, 2 and 5 times a power of ten with which a raster of the
/// box has at most 25 million cells.
double affordable_cell_m(const Eigen::AlignedBox2d& box, double cell_m);

/// Surface and its change against the base surface, as GeoTIFF.
/// @throw std::runtime_error naming the file and the cause, too many cells being one.
void write_surface_raster(const std::filesystem::path& file, const Ground& ground,
                          const Eigen::AlignedBox2d& box, double cell_m,
                          const std::string& crs_wkt);

/// @throw io::InputError if `to` can't be written: it is one of the inputs, a folder, or its folder
///        isn't there.
void check_output(const std::filesystem::path& to, const std::filesystem::path& input);

}  // namespace soilvdb::tools
