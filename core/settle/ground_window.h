// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground over a rectangle of cells as heights of columns, for soil that falls and slides.
#pragma once

#include <cstdint>
#include <vector>

#include "core/settle/base_columns.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

using Coord2 = Eigen::Vector2i;

/// Heights of the topmost soil over a rectangle of cells, in index space: the top of cell k is at k
/// + 0.5. They are counted: soil above the topmost cell full of bank counts with its volume, so
/// added soil fills pores below before heights rise.
class GroundWindow {
 public:
  struct Column {
    double top = 0;      ///< of all soil
    double surface = 0;  ///< top of the topmost cell with soil, pores below it or not
    double bank = 0;     ///< of the soil without the loose soil on it
    int full = 0;        ///< all cells are full up to this one: nothing can be added below
    int bank_full = 0;   ///< the topmost cell full of bank soil
    bool known = false;  ///< the terrain has ground everywhere in it
    /// Loose soil without support: the lowest piece, its cells and samples.
    int hangs_low = 0, hangs_high = 0;
    std::int64_t hangs = 0;
  };

  /// @param first the lowest cell; nx, ny numbers of cells
  GroundWindow(BaseColumns& base, const Coord2& first, int nx, int ny);
  /// The same without a cache.
  GroundWindow(const Ground& ground, const Coord2& first, int nx, int ny);

  const Coord2& first() const { return first_; }
  int nx() const { return nx_; }
  int ny() const { return ny_; }
  /// x, y from 0
  const Column& at(int x, int y) const { return columns_[index(x, y)]; }
  bool has_loose() const { return has_loose_; }
  bool has_hanging() const { return has_hanging_; }

 private:
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(x * ny_ + y); }
  class Descent;

  Coord2 first_;
  int nx_, ny_;
  bool has_loose_ = false, has_hanging_ = false;
  std::vector<Column> columns_;
};

}  // namespace soilvdb::inline v0
