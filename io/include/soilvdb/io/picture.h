// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Pictures for people: a shaded plan with cut and fill in colour, and a lit view of the same.
#pragma once

#include <filesystem>
#include <string>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0::io {

/// What a picture says in words.
struct Caption {
  std::string title;   ///< the scenario's name
  std::string detail;  ///< e.g. "cut 1.83 m3, 5 cm voxels, EPSG:26918"
};

/// Shaded plan of a box of the world: hillshade, cut and fill in colour, loose soil as clods,
/// contours, scale bar, legend, north arrow, coordinates at the frame. PNG.
/// @throw std::runtime_error naming the file and the cause.
void write_plan(const std::filesystem::path& file, const Ground& ground,
                const Eigen::AlignedBox2d& box, const Caption& caption);

/// Perspective view of the same box: ray-traced level set, sun and shadow, the same colours.
void write_view(const std::filesystem::path& file, const Ground& ground,
                const Eigen::AlignedBox2d& box, const Caption& caption);

/// The columns of the resident ground and of that beneath it, world; empty if there are none.
/// @param changed_only of the chunks alone that have lost soil or hold soil that was moved
Eigen::AlignedBox2d footprint(const Ground& ground, bool changed_only);

/// What columns a voxel wide lost and gained since before anyone dug, each with its own net.
struct CutAndFill {
  double cut_m3 = 0, fill_m3 = 0;
};
CutAndFill cut_and_fill(const Ground& ground);

/// Is any of the ground's soil loose?
bool has_loose(const Ground& ground);

/// The box of the world a picture of this soil should show: the ground that changed, with a margin.
Eigen::AlignedBox2d region_of_interest(const Ground& ground);

}  // namespace soilvdb::inline v0::io
