// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights of the ground at the pixels of a picture, and their colours from above.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
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
  double datum_m = 0;             ///< a height in the box, so that floats keep their precision
  std::vector<float> height;      ///< above datum_m; NaN where there is no ground
  std::vector<float> depth;       ///< base surface minus ground, m; 0 where nothing changed
  std::vector<float> loose = {};  ///< loose share of the soil at the surface; empty: no loose soil

  double cell_x() const { return box.sizes().x() / nx; }
  double cell_y() const { return box.sizes().y() / ny; }
  /// Centre of a cell, world.
  Vec2 middle(int x, int y) const {
    return {box.min().x() + (x + 0.5) * cell_x(), box.max().y() - (y + 0.5) * cell_y()};
  }
  std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(nx) + static_cast<std::size_t>(x);
  }
};

/// Height at (x, y) of the world; empty where there is no ground.
using HeightFunction = std::function<std::optional<double>(double x, double y)>;

/// Samples both surfaces; they must be thread-safe.
/// @param least_m smaller changes count as no change
/// @param filled false: a rise counts as no change
Relief sample_relief(const HeightFunction& now, const HeightFunction& base,
                     const Eigen::AlignedBox2d& box, int nx, int ny, double least_m, bool filled);

/// Lowest and highest ground, m above the datum; empty if there is no ground.
struct HeightRange {
  float low = 0, high = 0;
};
std::optional<HeightRange> height_range(const Relief& relief);
/// Deepest cut and highest fill, m.
float deepest(const Relief& relief);
float highest(const Relief& relief);

/// Fills in `loose`.
/// @param loose loose share of the soil about a point of the world
void sample_loose(Relief& relief, const std::function<double(const Vec3&)>& loose,
                  double voxel_size_m);

/// Bilinear depth at (x, y) of the world, clamped to the box.
double depth_at(const Relief& relief, double x, double y);

inline constexpr Rgb kEarth{0.800, 0.765, 0.705};

/// How a plan is drawn.
struct PlanStyle {
  double voxel_size_m = 0;
  ChangeScale scale;
  double contour_m = 0;  ///< height between contours; 0: none
};

/// Opaque pixels, row by row: earth tones with hillshade, changes in colour, loose soil as clods,
/// contours.
std::vector<std::uint32_t> shade(const Relief& relief, const PlanStyle& style);

/// A place for a contour's label, px in the relief.
struct ContourLabel {
  double x = 0, y = 0, angle = 0;  ///< angle: along the contour, with upright letters
  double height_m = 0;
};
/// At most one label on each fifth contour, apart from other labels, the rim and changes.
std::vector<ContourLabel> label_contours(const Relief& relief, const PlanStyle& style);

}  // namespace soilvdb::inline v0::io
