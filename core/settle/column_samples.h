// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Columns of cells that rise or fall by so many samples, in the shape of a surface.
#pragma once

#include <cstdint>
#include <span>

#include "core/settle/ground_window.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// By how many samples a column changes, and the surface that it is to have: a cone, or a plane.
struct ColumnEdit {
  Coord2 cell;           ///< x, y
  int low, high;         ///< cells of z that may change
  std::int64_t samples;  ///< to be added, or to be removed
  bool cone;
  float a, b;  ///< a cone's apex from the column's corner, cells; or a plane's slopes
};

/// Adds loose samples to columns: of the air in a column those that are lowest below a surface of
/// its shape. So heights are those asked for to a sample, also where bank stands in a part of a
/// column.
/// @param slope of cones
/// @return how many were added: fewer only if there is no more room in the columns' cells
std::int64_t add_loose(Ground& ground, std::span<const ColumnEdit> changes, double slope);

/// Soil that was taken out, samples.
struct Taken {
  std::int64_t bank = 0, loose = 0;
};
/// Removes samples from columns, the highest above surfaces first: loose soil, or with `bank` any.
Taken remove_top(Ground& ground, std::span<const ColumnEdit> changes, double slope, bool bank);

}  // namespace soilvdb::inline v0
