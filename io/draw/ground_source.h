// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the pictures ask of the ground, so that they can also be drawn of plain functions.
#pragma once

#include <functional>
#include <string>

#include "io/draw/relief.h"
#include "soilvdb/io/picture.h"

namespace soilvdb::inline v0::io {

/// Two surfaces and where they differ.
struct Ground {
  HeightFunction now, base;
  double voxel_size_m = 0;
  Eigen::AlignedBox2d cut;  ///< holds all that was cut; empty where nothing was

  /// Changes of less than this aren't drawn: the surface may be as much off.
  double least_m() const { return 0.1 * voxel_size_m; }
};

Ground ground_of(const Soil& soil);

/// One scale for every picture of a box, however coarse its pixels are.
DepthScale depth_scale(const Ground& ground, const Eigen::AlignedBox2d& box);

/// A box that can be drawn: finite, and grown about its centre to at least twelve to one and 4
/// voxels. @throw std::invalid_argument if it is empty or not finite.
Eigen::AlignedBox2d drawable(const Eigen::AlignedBox2d& box, double voxel_size_m);

/// The picture write_plan() writes.
Canvas draw_plan(const Ground& ground, const Eigen::AlignedBox2d& box, const Caption& caption);

/// Writes the picture as PNG. @throw std::runtime_error naming the file and the cause.
void save(const std::filesystem::path& file, Canvas& canvas);

}  // namespace soilvdb::inline v0::io
