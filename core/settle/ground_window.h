// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground over a rectangle of cells as heights of columns, for soil that falls and slides.
#pragma once

#include <vector>

#include "core/settle/ground_columns.h"

namespace soilvdb::inline v0 {

/// The columns over a rectangle of cells.
class GroundWindow {
 public:
  using Column = GroundColumn;

  /// @param first the lowest cell; nx, ny numbers of cells
  GroundWindow(GroundColumns& ground, const Coord2& first, int nx, int ny);
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
  template <typename TileAt>
  void read(const TileAt& tile_at);

  Coord2 first_;
  int nx_, ny_;
  bool has_loose_ = false, has_hanging_ = false;
  std::vector<Column> columns_;
};

}  // namespace soilvdb::inline v0
