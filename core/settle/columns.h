// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground as heights of square columns, for soil that falls and slides.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// Ground given by the heights of square columns. Column (x, y) covers [x, x + 1] x [y, y + 1]
/// sides from the corner (0, 0), has number x * ny + y, and its height is that at its middle. Rigid
/// columns, and all outside, are walls of any height: no soil goes there or is lost.
struct Columns {
  int nx = 0, ny = 0;
  double side_m = 0;
  std::vector<double> height_m;
  /// Heights of the firm ground below loose soil; empty: all is firm. Edges that soil runs over are
  /// found in it, because loose soil on them blurs them by half a side.
  std::vector<double> firm_m;
  std::vector<std::uint8_t> rigid;  ///< empty: no column is; kUnread: `read` tells first
  static constexpr std::uint8_t kUnread = 2;
  /// Sets a column that is unread, and may set others. Heights of a column hold once open() was
  /// asked for it, so that of a large window only what soil comes to is read.
  std::function<void(int column)> read;

  Columns() = default;
  Columns(int columns_x, int columns_y, double side, double height = 0)
      : nx(columns_x),
        ny(columns_y),
        side_m(side),
        height_m(static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny), height) {}

  int index(int x, int y) const { return x * ny + y; }
  bool has(int x, int y) const { return x >= 0 && y >= 0 && x < nx && y < ny; }
  double at(int column) const { return height_m[static_cast<std::size_t>(column)]; }
  double firm_at(int column) const {
    return firm_m.empty() ? at(column) : firm_m[static_cast<std::size_t>(column)];
  }
  double& at(int column) { return height_m[static_cast<std::size_t>(column)]; }
  /// Can soil lie on it?
  bool open(int x, int y) const { return has(x, y) && open(index(x, y)); }
  bool open(int column) const {
    if (rigid.empty()) return true;
    const std::uint8_t& here = rigid[static_cast<std::size_t>(column)];
    if (here == kUnread) read(column);
    return here == 0;
  }
};

}  // namespace soilvdb::inline v0
