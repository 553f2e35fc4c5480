// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Tiles of columns, each once, in one order.
#pragma once

#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::inline v0 {

/// Tiles by their lowest cells, ordered by x, then y.
class TileSet {
 public:
  bool empty() const { return tiles_.empty(); }
  void clear() { tiles_.clear(); }
  void add(const Coord2& tile) { tiles_.emplace(tile.x(), tile.y()); }
  bool has(const Coord2& tile) const { return tiles_.count({tile.x(), tile.y()}) > 0; }
  /// @return whether it was there
  bool remove(const Coord2& tile) { return tiles_.erase({tile.x(), tile.y()}) > 0; }
  /// All tiles with cells of a box.
  void add(const Eigen::AlignedBox2i& cells) {
    const Coord2 first = floor_to(cells.min(), kChunkSide);
    for (int x = first.x(); x <= cells.max().x(); x += kChunkSide)
      for (int y = first.y(); y <= cells.max().y(); y += kChunkSide) add(Coord2(x, y));
  }
  /// Calls f(tile) for each.
  template <typename F>
  void each(const F& f) const {
    for (const auto& [x, y] : tiles_) f(Coord2(x, y));
  }

  void save(std::string& out) const {
    put(out, std::uint64_t{tiles_.size()});
    for (const auto& [x, y] : tiles_) {
      put(out, x);
      put(out, y);
    }
  }
  /// @throw std::invalid_argument if the bytes are not from save()
  void load(std::string_view& in) {
    std::uint64_t count = 0;
    take(in, count);
    if (count > in.size() / (2 * sizeof(int)))
      throw std::invalid_argument("the state ends too early");
    clear();
    for (; count > 0; --count) {
      Coord2 tile;
      take(in, tile.x());
      take(in, tile.y());
      const bool valid = tile == floor_to(tile, kChunkSide) &&
                         tile.cast<double>().cwiseAbs().maxCoeff() <= kMaxPlaceIndex;
      if (!valid) throw std::invalid_argument("the state has an invalid tile");
      add(tile);
    }
  }

 private:
  std::set<std::pair<int, int>> tiles_;
};

}  // namespace soilvdb::inline v0
