// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Adds samples to columns of cells, or removes them, in the shape of a surface.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Change of a column in samples, and the surface that it shall have: a cone or a plane.
struct ColumnEdit {
  Coord2 cell;               ///< x, y
  int low, high;             ///< cells of z that may change
  std::int64_t samples = 0;  ///< to be added, or to be removed
  bool cone = false;
  float a = 0, b = 0;  ///< a cone's apex from the column's corner, cells; or a plane's slopes

  static constexpr auto kAll = std::numeric_limits<std::int64_t>::max();
  /// To remove all.
  static ColumnEdit all(const Coord2& cell, int low, int high) {
    return {.cell = cell, .low = low, .high = high, .samples = kAll};
  }
};

/// Receives the samples of a chunk that were added or removed: bank or loose ones, in turn.
using ChunkReceiver =
    std::function<void(const Coord3& origin, const SampleWords& samples, bool loose)>;

/// Adds samples to columns: the lowest air below a surface of the column's shape. Heights are thus
/// as requested to a sample, also if bank stands in a part of a column.
/// @param slope of cones @param loose false: bank, where soil is rigid
/// @return number of samples added, fewer only if the columns' cells have no more room
std::int64_t add_samples(Ground& ground, std::span<const ColumnEdit> changes, double slope,
                         bool loose, const ChunkReceiver& added = {});

/// Removed soil, samples.
struct Taken {
  std::int64_t bank = 0, loose = 0;
};
/// Removes samples of any soil, the highest above surfaces first.
Taken remove_top(Ground& ground, std::span<const ColumnEdit> changes, double slope,
                 const ChunkReceiver& removed = {});
/// The same of loose soil alone. @return number of removed samples by column, as many as there were
std::vector<std::int64_t> remove_loose(Ground& ground, std::span<const ColumnEdit> changes,
                                       double slope);

}  // namespace soilvdb::inline v0
