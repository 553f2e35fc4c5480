// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Surfaces of triangles (TIN) from design programs: LandXML, DXF.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "io/file/file_part.h"
#include "soilvdb/io/raster.h"

namespace soilvdb::inline v0::io {

struct Tin {
  std::vector<Vec3> points;                         ///< east, north, height
  std::vector<std::array<std::uint32_t, 3>> faces;  ///< of points, in any turn
};

inline constexpr std::size_t kMostTinPoints = 10'000'000, kMostTinFaces = 20'000'000;

/// A surface in the units of its file.
struct TinInput {
  Tin tin;
  double unit_m = 1, height_unit_m = 1;
  std::string unit = {};                 ///< its name in the file
  std::string epsg = {}, wkt = {};       ///< CRS as the file gives it; empty: unknown
  std::vector<std::string> doubts = {};  ///< without the file's name
};

/// @throw InputError unless the file has one surface of triangles, or one of the name
TinInput read_landxml(const FilePart& from);
TinInput read_dxf(const FilePart& from);
/// The units of a DXF, without triangles. @throw InputError for an unknown one
TinInput dxf_units(const std::filesystem::path& file);

/// A surface in metres as posts. They span the bounds of its faces, at most 2^24 of them, and
/// are at least 1/32 m apart. Their heights are exact, of the highest face; those beside all faces
/// have none.
/// @throw InputError as above, and for a CRS that no raster may have
RasterInput open_tin(const std::filesystem::path& path);

/// The one surface of several to read. @throw InputError if it isn't clear which
std::size_t choose_surface(const FilePart& from, const std::vector<std::string>& names);

/// Writes posts with heights as a LandXML surface in metres. Atomic.
/// @param heights row-major from low y to high y, NaN where there is no height
void write_landxml(const std::filesystem::path& file, const HeightGrid& grid,
                   const std::vector<float>& heights, const std::string& name,
                   const std::string& crs_wkt);

}  // namespace soilvdb::inline v0::io
