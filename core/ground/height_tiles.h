// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The posts of a height field, read by tile when first needed.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "core/lattice/ray_walk.h"
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

  /// Height of a post; NaN without one.
  float at(int x, int y) const {
    const Tile& t = tile(x / kRaySide, y / kRaySide);
    const int in_x = x & (kRaySide - 1), in_y = y & (kRaySide - 1);
    const int nx = std::min(kRaySide, grid_.nx - (x - in_x));
    return t.posts[std::size_t(in_y) * nx + in_x];
  }
  /// Highest posts of squares of patches in a block of them, from level 1 on; valid until forget().
  const float* highest(int bx, int by) const;
  /// Of the square that a ray is in. @param block what highest() gave for it
  static float highest_of(const float* block, int level, const RayWalk& walk) {
    return block[ray_level_begin(level, 1) + square_of(walk.x(), walk.y(), level)];
  }

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
  using Highest = std::array<float, ray_level_begin(kRayLevels + 1, 1)>;
  using Blocks = std::vector<std::atomic<Highest*>>;
  Blocks& blocks() const;
  /// Number of a patch's square within its block and level.
  static std::size_t square_of(int x, int y, int level) {
    const int in_x = x & (kRaySide - 1), in_y = y & (kRaySide - 1);
    return std::size_t(in_x >> level) << (kRayLevels - level) | std::size_t(in_y >> level);
  }
  const Tile& tile(int tx, int ty) const;
  void range(const Vec2& low, const Vec2& high, int margin, int& x0, int& y0, int& x1, int& y1,
             bool& inside) const;

  HeightGrid grid_;
  std::shared_ptr<const HeightSource> source_;
  int tiles_x_, tiles_y_;
  mutable std::vector<std::atomic<Tile*>> tiles_;
  mutable std::atomic<Blocks*> blocks_ = nullptr;  // made when a ray first comes, each by its first
  mutable std::atomic<std::uint64_t> held_ = 0;
  mutable std::mutex mutex_;
};

}  // namespace soilvdb::inline v0
