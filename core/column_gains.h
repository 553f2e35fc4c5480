// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What columns of the world gained of soil, of any width, wherever voxels lie.
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "core/soil.h"

namespace soilvdb {

/// By which the count of a cell that a surface cuts is wrong, root mean square in the worst
/// direction, of the cell (core/sample_points.cc).
inline constexpr double kCountError = 0.022;

/// Square columns that tile the world.
struct ColumnGrid {
  Vec2 origin;  ///< middle of column (0, 0), world, m
  double side_m;
  using Column = std::pair<int, int>;
  Column at(const Vec2& p) const;
};

/// What a column gained, and the variance of that.
struct Gain {
  double m3 = 0, variance = 0;
  void add(const Gain& other);
};

using GainFunction = std::function<void(const ColumnGrid::Column&, const Gain&)>;
/// Reads the samples of a chunk as they were and as they are.
using ReadChange = std::function<void(const Coord3&, SampleWords& before, SampleWords& after)>;

/// Calls `f` with what columns gained in chunks of a soil, chunk by chunk, in their order: a cell
/// that changed whole shared out by area, any other by its samples. Chunks in parallel, `f` not.
void for_each_gain(const Soil& soil, const std::vector<Coord3>& chunks, const ReadChange& read,
                   const ColumnGrid& grid, const GainFunction& f);

/// The same for a soil against its base surface. The sum is Soil::change_m3() to rounding.
void for_each_gain(const Soil& soil, const ColumnGrid& grid, const GainFunction& f);

}  // namespace soilvdb
