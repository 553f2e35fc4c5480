// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Adds samples to columns of cells, or removes them, in the shape of a surface.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "core/lattice/cell_counts.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Change of a column in samples, and the surface that it shall have: a cone or a plane.
struct ColumnEdit {
  Coord2 cell;           ///< x, y
  int low, high;         ///< cells of z that may change
  std::int64_t samples;  ///< to be added, or to be removed
  bool cone;
  float a, b;  ///< a cone's apex from the column's corner, cells; or a plane's slopes
};

/// Receives what changed in a chunk, by cells.
using ChunkCounts =
    std::function<void(const Coord3& origin, const CellCounts& bank, const CellCounts& loose)>;

/// Adds loose samples to columns: the lowest air below a surface of the column's shape. Heights are
/// thus as requested to a sample, also if bank stands in a part of a column.
/// @param slope of cones
/// @return number of samples added, fewer only if the columns' cells have no more room
std::int64_t add_loose(Ground& ground, std::span<const ColumnEdit> changes, double slope,
                       const ChunkCounts& added = {});
/// The same with bank soil, where soil is rigid.
std::int64_t add_bank(Ground& ground, std::span<const ColumnEdit> changes, double slope,
                      const ChunkCounts& added = {});

/// Removed soil, samples.
struct Taken {
  std::int64_t bank = 0, loose = 0;
};
/// Removes samples, the highest above surfaces first: loose soil or, with `bank`, any soil.
Taken remove_top(Ground& ground, std::span<const ColumnEdit> changes, double slope, bool bank,
                 const ChunkCounts& removed = {});

}  // namespace soilvdb::inline v0
