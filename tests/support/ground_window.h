// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground over a rectangle of cells as heights of columns.
#pragma once

#include <vector>

#include "core/ground/ground_columns.h"

namespace soilvdb::test {

/// The columns over a rectangle of cells.
class GroundWindow {
 public:
  using Column = GroundColumn;

  /// @param first the lowest cell; nx, ny numbers of cells
  GroundWindow(const Ground& ground, const Coord2& first, int nx, int ny);

  const Coord2& first() const { return first_; }
  int nx() const { return nx_; }
  int ny() const { return ny_; }
  /// x, y from 0
  const Column& at(int x, int y) const { return columns_[index(x, y)]; }
  bool has_hanging() const { return has_hanging_; }

 private:
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(x * ny_ + y); }

  Coord2 first_;
  int nx_, ny_;
  bool has_hanging_ = false;
  std::vector<Column> columns_;
};

}  // namespace soilvdb::test
