// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Surfaces over columns of cells, made of samples: exactly so many are added, or all above removed.
#pragma once

#include <cstdint>
#include <span>

#include "core/settle/ground_window.h"
#include "soilvdb/soil.h"

namespace soilvdb::inline v0 {

/// A surface over a column: a cone, or a plane.
struct ColumnSurface {
  Coord2 cell;    ///< x, y
  int low, high;  ///< cells of z that it concerns
  bool cone;
  float height;  ///< of the cone's apex, or of the plane in the middle; cells above `low`
  float a, b;    ///< the apex from the column's corner, cells; or the plane's slopes
  float beyond;  ///< of a cone: soil comes to (a, b) from so far
};

/// Fills air below surfaces with loose soil: of all their samples those that are lowest below them,
/// or least above them, exactly so many. The same samples whatever the order of columns.
/// @param slope of cones
/// @return how many were added: fewer only if there is no more room in the columns' cells
std::int64_t fill_below(Soil& soil, std::span<const ColumnSurface> surfaces, double slope,
                        std::int64_t samples);

/// Soil that was taken out, samples.
struct Taken {
  std::int64_t bank = 0, loose = 0;
};
/// Removes loose soil above surfaces, or with `bank` all soil.
Taken remove_above(Soil& soil, std::span<const ColumnSurface> surfaces, double slope, bool bank);

}  // namespace soilvdb::inline v0
