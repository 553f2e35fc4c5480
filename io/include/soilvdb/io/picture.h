// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Pictures for people: a shaded plan with cut and fill in colour, and a lit view of the same.
#pragma once

#include <filesystem>
#include <string>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0::io {

/// A picture's text.
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

/// The columns of the resident ground and of the ground beneath it, world; empty if there are none.
/// @param changed_only only chunks that lost soil or hold moved soil
Eigen::AlignedBox2d footprint(const Ground& ground, bool changed_only);

/// Loss and gain of all voxel-wide columns since before digging, each column with its net change.
struct CutAndFill {
  double cut_m3 = 0, fill_m3 = 0;
};
CutAndFill cut_and_fill(const Ground& ground);

/// Is any of the ground's soil loose?
bool has_loose(const Ground& ground);

/// The box of the world that a picture of this soil should show: the changed ground, with a margin.
Eigen::AlignedBox2d region_of_interest(const Ground& ground);

}  // namespace soilvdb::inline v0::io
