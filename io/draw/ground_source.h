// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the pictures ask of the ground, so that they can also be drawn of plain functions.
#pragma once

#include <functional>

#include "io/draw/relief.h"
#include "soilvdb/io/picture.h"

namespace soilvdb::inline v0::io {

/// Two surfaces and where they differ.
struct DrawnGround {
  HeightFunction now, base;
  double voxel_size_m = 0;
  Eigen::AlignedBox2d changed;  ///< holds all that changed; empty where nothing did
  bool filled = false;          ///< soil was added; else what is higher than it was is noise
  /// Share of the soil about a point of the world that is loose; null: none is anywhere.
  std::function<double(const Vec3&)> loose = {};

  /// Changes of less than this aren't drawn: the surface may be as much off.
  double least_m() const { return 0.1 * voxel_size_m; }
};

DrawnGround ground_of(const Ground& ground);
/// DrawnGround::loose of a ground.
std::function<double(const Vec3&)> loose_of(const Ground& ground);

/// Samples both surfaces at the centres of nx x ny cells.
Relief relief_of(const DrawnGround& ground, const Eigen::AlignedBox2d& box, int nx, int ny);

/// One scale for every picture of a box, however coarse its pixels are.
ChangeScale change_scale(const DrawnGround& ground, const Eigen::AlignedBox2d& box);

/// A box that can be drawn: finite, and grown about its centre to at least twelve to one and 4
/// voxels. @throw std::invalid_argument if it is empty or not finite.
Eigen::AlignedBox2d drawable(const Eigen::AlignedBox2d& box, double voxel_size_m);

/// The picture write_plan() writes.
Canvas draw_plan(const DrawnGround& ground, const Eigen::AlignedBox2d& box, const Caption& caption);

/// Writes the picture as PNG. @throw std::runtime_error naming the file and the cause.
void save(const std::filesystem::path& file, Canvas& canvas);

}  // namespace soilvdb::inline v0::io
