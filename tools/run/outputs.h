// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Output files that several commands write, and their region of the world.
#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <string>

#include "soilvdb/ground.h"

namespace soilvdb::tools {

/// Parses XMIN,YMIN,XMAX,YMAX. @throw io::InputError with the right syntax.
Eigen::AlignedBox2d parse_region(const std::string& text);

/// `cell_m`, or else the next of 1, 2 and 5 times a power of ten at which a raster of the box has
/// at most `most_cells` cells.
double affordable_cell_m(const Eigen::AlignedBox2d& box, double cell_m, double most_cells = 25e6);

/// Looks up sigmas of heights at places, and what was seen, as Site::sigmas().
using Sigmas = std::function<void(std::span<const Vec2> xy_m, std::span<double> sigmas_m,
                                  std::span<double> seen)>;

/// Writes the surface and its change against the base surface as GeoTIFF.
/// @param sigmas for two more bands, of the columns at the cells' centres; empty: without
/// @throw std::runtime_error naming the file and the cause, also for too many cells.
void write_surface_raster(const std::filesystem::path& file, const Ground& ground,
                          const Eigen::AlignedBox2d& box, double cell_m, const std::string& crs_wkt,
                          const Sigmas& sigmas = {});

/// @throw io::InputError if `to` can't be written: it is an input or a folder, or its folder does
///        not exist.
void check_output(const std::filesystem::path& to, const std::filesystem::path& input);

}  // namespace soilvdb::tools
