// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground as functions, so that pictures can also show plain functions.
#pragma once

#include <functional>

#include "io/draw/relief.h"
#include "soilvdb/io/picture.h"

namespace soilvdb::inline v0::io {

/// Two surfaces and where they differ.
struct DrawnGround {
  HeightFunction now, base;
  double voxel_size_m = 0;
  Eigen::AlignedBox2d changed;  ///< holds all changes; empty where nothing changed
  bool filled = false;          ///< soil was added; if false, a rise is noise
  /// Loose share of the soil about a point of the world; null if no soil is loose.
  std::function<double(const Vec3&)> loose = {};

  /// Smaller changes are not drawn: the surface's error may be as large.
  double least_m() const { return 0.1 * voxel_size_m; }
};

DrawnGround ground_of(const Ground& ground);
/// DrawnGround::loose of a ground.
std::function<double(const Vec3&)> loose_of(const Ground& ground);

/// Samples both surfaces at the centres of nx x ny cells.
Relief relief_of(const DrawnGround& ground, const Eigen::AlignedBox2d& box, int nx, int ny);

/// The same scale for every picture of a box, whatever its resolution.
ChangeScale change_scale(const DrawnGround& ground, const Eigen::AlignedBox2d& box);

/// Grows a box about its centre so that it can be drawn: sides at most 12:1, and at least 4 voxels.
/// @throw std::invalid_argument if it is empty or not finite.
Eigen::AlignedBox2d drawable(const Eigen::AlignedBox2d& box, double voxel_size_m);

/// The picture write_plan() writes.
Canvas draw_plan(const DrawnGround& ground, const Eigen::AlignedBox2d& box, const Caption& caption);

/// Writes the picture as PNG. @throw std::runtime_error naming the file and the cause.
void save(const std::filesystem::path& file, Canvas& canvas);

}  // namespace soilvdb::inline v0::io
