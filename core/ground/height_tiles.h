// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The posts of a height field, read by tile when first needed.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {

/// Posts of a HeightSource. Several threads may call its members; forget() needs exclusive access.
class HeightTiles {
 public:
  HeightTiles(const HeightGrid& grid, std::shared_ptr<const HeightSource> source);
  ~HeightTiles() { forget(); }
  HeightTiles(const HeightTiles&) = delete;
  HeightTiles& operator=(const HeightTiles&) = delete;

  const HeightGrid& grid() const { return grid_; }
  /// A place in plan, in posts.
  Vec2 post(double x, double y) const {
    return (Vec2(x, y) - grid_.first).cwiseQuotient(grid_.spacing);
  }

  /// Bounds of heights; low > high without any height.
  struct Bounds {
    double low, high;
    bool complete;  ///< all posts are there, with a height
  };

  /// Bounds of the posts of all patches over a rectangle and a margin; may be looser.
  Bounds bounds(const Vec2& low, const Vec2& high, int margin) const;

  /// Posts of a rectangle gathered for quick access.
  struct Window {
    int x0, y0, nx, ny;
    std::vector<float> posts;
    double low, high;
    bool complete;

    float at(int x, int y) const { return posts[std::size_t(y - y0) * nx + (x - x0)]; }
  };
  /// Posts of the patches over a rectangle. Valid until the next call on this thread.
  const Window& window(const Vec2& low, const Vec2& high) const;

  std::uint64_t memory_bytes() const {
    return tiles_.size() * sizeof(tiles_[0]) + held_.load(std::memory_order_relaxed);
  }
  void forget() const;

 private:
  struct Tile {
    std::vector<float> posts;
    float low, high;  // of posts with a height; low > high without any
    bool complete;
  };
  const Tile& tile(int tx, int ty) const;
  void range(const Vec2& low, const Vec2& high, int margin, int& x0, int& y0, int& x1, int& y1,
             bool& inside) const;

  HeightGrid grid_;
  std::shared_ptr<const HeightSource> source_;
  int tiles_x_, tiles_y_;
  mutable std::vector<std::atomic<Tile*>> tiles_;
  mutable std::atomic<std::uint64_t> held_ = 0;
  mutable std::mutex mutex_;
};

}  // namespace soilvdb::inline v0
