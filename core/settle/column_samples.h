// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Adds samples to columns of cells, or removes them, in the shape of a surface.
#pragma once

#include <array>
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
  bool rises = false;  ///< which change_samples() asks: samples are added

  static constexpr auto kAll = std::numeric_limits<std::int64_t>::max();
  /// To remove all.
  static ColumnEdit all(const Coord2& cell, int low, int high) {
    return {.cell = cell, .low = low, .high = high, .samples = kAll};
  }
};

/// Adds loose samples to columns: the lowest air below a surface of the column's shape. Heights are
/// thus as requested to a sample, also if bank stands in a part of a column.
/// @param slope of cones
/// @return number of samples added, fewer only if the columns' cells have no more room
std::int64_t add_samples(Ground& ground, std::span<const ColumnEdit> changes, double slope);

/// Removed soil, samples.
struct Taken {
  std::int64_t bank = 0, loose = 0;
};
/// Removes samples of any soil, the highest above surfaces first.
Taken remove_top(Ground& ground, std::span<const ColumnEdit> changes, double slope);
/// The same of loose soil alone. @return number of removed samples by column, as many as there were
std::vector<std::int64_t> remove_loose(Ground& ground, std::span<const ColumnEdit> changes,
                                       double slope);

/// Samples added to the columns of a chunk, less those removed. Column (x, y) is entry x * 8 + y.
struct ColumnCounts {
  std::array<std::int32_t, kChunkSide * kChunkSide> bank{}, loose{};
};
using CountReceiver = std::function<void(const Coord3& chunk, const ColumnCounts& counts)>;
struct ChangedSamples {
  std::int64_t added = 0;
  Taken taken;
};
/// Adds samples to columns that rise, and removes samples of any soil from others; of planes. Does
/// in one pass what add_samples() and remove_top() do if the columns differ.
/// @param loose false: bank is added, where soil is rigid
/// @param receiver is called once for each chunk that changed
ChangedSamples change_samples(Ground& ground, std::span<const ColumnEdit> changes, bool loose,
                              const CountReceiver& receiver);

}  // namespace soilvdb::inline v0
