// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights of the ground on the pixels of a picture, and how they look from above.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "io/draw/canvas.h"
#include "io/draw/map_parts.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

/// Heights at the centres of nx x ny equal cells of a box, row by row from high y (the picture's
/// top) to low y.
struct Relief {
  int nx = 0, ny = 0;
  Eigen::AlignedBox2d box;
  double datum_m = 0;         ///< a height in the box: floats keep their precision anywhere
  std::vector<float> height;  ///< above datum_m; NaN where there is no ground
  std::vector<float> depth;   ///< base surface less the ground now; 0 where nothing was cut

  double cell_x() const { return box.sizes().x() / nx; }
  double cell_y() const { return box.sizes().y() / ny; }
  std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(nx) + static_cast<std::size_t>(x);
  }
};

/// Height at (x, y) of the world, nothing where there is no ground.
using HeightFunction = std::function<std::optional<double>(double x, double y)>;

/// Samples both surfaces; they must be safe to call from several threads.
/// @param least_m ground that is less deep than that is as it was
Relief sample_relief(const HeightFunction& now, const HeightFunction& base,
                     const Eigen::AlignedBox2d& box, int nx, int ny, double least_m);

/// Lowest and highest ground, m above the datum; nothing where there is no ground at all.
struct HeightRange {
  float low = 0, high = 0;
};
std::optional<HeightRange> height_range(const Relief& relief);
float deepest(const Relief& relief);

/// Bilinear depth at (x, y) of the world, clamped to the box.
double depth_at(const Relief& relief, double x, double y);

/// How a plan is drawn.
struct PlanStyle {
  double voxel_size_m = 0;
  DepthScale scale;
  double contour_m = 0;  ///< height between contours; 0: none
};

/// Opaque pixels, row by row: earth tones under a hillshade, cut depth in colour, contours.
std::vector<std::uint32_t> shade(const Relief& relief, const PlanStyle& style);

/// Where a contour can be labelled, px in the relief.
struct ContourLabel {
  double x = 0, y = 0, angle = 0;  ///< angle: along the contour, so that letters stand upright
  double height_m = 0;
};
/// At most one label on each fifth contour, apart from each other, the rim and the cut.
std::vector<ContourLabel> label_contours(const Relief& relief, const PlanStyle& style);

}  // namespace soilvdb::inline v0::io
