// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The points of a scan: of a file, or of a message that a robot recorded.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "soilvdb/io/error.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

struct PointCloud {
  std::vector<Vec3> points_m;      ///< in the file's order and frame, all finite
  std::size_t without_return = 0;  ///< points of the file that are not kept, see read_points()

  /// Leaves out a recording's strays: points farther from its origin than any sensor sees.
  /// @return how many
  std::size_t leave_out_far();
};

/// Reads the points of a scan. The content gives the format, not the file's name:
/// - PLY 1.0, text and binary of both byte orders: x, y, z of `element vertex`;
/// - PCD up to 0.7, text, binary and compressed: the fields x, y, z;
/// - LAS 1.0 to 1.4, point formats 0 to 10, points of all classes;
/// - text: columns named x, y, z, or else the first three. Separators are spaces, commas or
///   semicolons. Comments begin with # or //. A first line of one integer, as PTS has it, is the
///   number of points.
///
/// x, y and z may have any type of number. A point without a return has a coordinate that is not
/// finite. It is also (0, 0, 0), where the sensor itself is, except in LAS. Coordinates are taken
/// as metres: no unit, coordinate system or PCD's VIEWPOINT is looked at. Thread-safe.
/// @throw InputError with the line or byte if the file can't be read, is damaged or truncated, has
///        no points, or has a coordinate beyond 1e9 m; for LAZ and E57 with the way to convert them
PointCloud read_points(const std::filesystem::path& file);

}  // namespace soilvdb::inline v0::io
