// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/ground/height_tiles.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/constants.h"

namespace soilvdb::inline v0 {

static_assert(kHeightTileSide == kRaySide);

HeightTiles::HeightTiles(const HeightGrid& grid, std::shared_ptr<const HeightSource> source)
    : grid_(grid),
      source_(std::move(source)),
      tiles_x_((grid.nx + kHeightTileSide - 1) / kHeightTileSide),
      tiles_y_((grid.ny + kHeightTileSide - 1) / kHeightTileSide),
      tiles_(std::size_t(tiles_x_) * tiles_y_) {}

void HeightTiles::forget() const {
  for (auto& tile : tiles_) delete tile.exchange(nullptr);
  if (const std::unique_ptr<Blocks> blocks{blocks_.exchange(nullptr)})
    for (auto& block : *blocks) delete block.load();
  held_ = 0;
}

const HeightTiles::Tile& HeightTiles::tile(int tx, int ty) const {
  std::atomic<Tile*>& slot = tiles_[std::size_t(ty) * tiles_x_ + tx];
  if (Tile* t = slot.load(std::memory_order_acquire)) return *t;
  const std::lock_guard lock(mutex_);
  if (Tile* t = slot.load(std::memory_order_acquire)) return *t;
  auto t = std::make_unique<Tile>();
  const int nx = std::min(kHeightTileSide, grid_.nx - tx * kHeightTileSide),
            ny = std::min(kHeightTileSide, grid_.ny - ty * kHeightTileSide);
  t->posts.resize(std::size_t(nx) * ny);
  source_->read(tx * kHeightTileSide, ty * kHeightTileSide, nx, ny, t->posts.data());
  t->low = std::numeric_limits<float>::infinity();
  t->high = -t->low;
  t->complete = true;
  for (const float z : t->posts) {
    if (std::isnan(z)) {
      t->complete = false;
    } else {
      t->low = std::min(t->low, z);
      t->high = std::max(t->high, z);
    }
  }
  held_ += sizeof(Tile) + t->posts.size() * sizeof(float);
  slot.store(t.get(), std::memory_order_release);
  return *t.release();
}

HeightTiles::Blocks& HeightTiles::blocks() const {
  if (Blocks* known = blocks_.load(std::memory_order_acquire)) return *known;
  auto made = std::make_unique<Blocks>(tiles_.size());
  Blocks* none = nullptr;  // another thread may have been quicker
  if (!blocks_.compare_exchange_strong(none, made.get(), std::memory_order_acq_rel)) return *none;
  held_ += tiles_.size() * sizeof(Blocks::value_type);
  return *made.release();
}

const float* HeightTiles::highest(int bx, int by) const {
  std::atomic<Highest*>& slot = blocks()[std::size_t(by) * tiles_x_ + bx];
  if (const Highest* known = slot.load(std::memory_order_acquire)) return known->data();
  auto made = std::make_unique<Highest>();
  constexpr float kNothing = -std::numeric_limits<float>::infinity();
  made->fill(kNothing);
  const int x0 = bx * kRaySide, y0 = by * kRaySide;
  for (int x = x0; x < std::min(x0 + kRaySide, grid_.nx - 1); ++x) {
    for (int y = y0; y < std::min(y0 + kRaySide, grid_.ny - 1); ++y) {
      const float corners[] = {at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)};
      if (std::any_of(corners, corners + 4, [](float z) { return std::isnan(z); })) continue;
      float& square = (*made)[square_of(x, y, 1)];
      square = std::max(square, *std::max_element(corners, corners + 4));
    }
  }
  for (int level = 2; level <= kRayLevels; ++level) {
    const int side = kRaySide >> level;
    for (int x = 0; x < 2 * side; ++x) {
      for (int y = 0; y < 2 * side; ++y) {
        const auto from = ray_level_begin(level - 1, 1) + std::size_t(x * 2 * side + y);
        float& square = (*made)[ray_level_begin(level, 1) + std::size_t(x / 2 * side + y / 2)];
        square = std::max(square, (*made)[from]);
      }
    }
  }
  Highest* none = nullptr;  // another thread may have been quicker
  if (slot.compare_exchange_strong(none, made.get(), std::memory_order_acq_rel)) {
    held_ += sizeof(Highest);
    return made.release()->data();
  }
  return none->data();
}

/// Posts around a rectangle; `inside` if the rectangle is within the grid.
void HeightTiles::range(const Vec2& low, const Vec2& high, int margin, int& x0, int& y0, int& x1,
                        int& y1, bool& inside) const {
  const Vec2 a = post(low.x(), low.y()), b = post(high.x(), high.y());
  inside = a.x() >= 0 && a.y() >= 0 && b.x() <= grid_.nx - 1 && b.y() <= grid_.ny - 1;
  const auto index = [](double v, int n) {
    return static_cast<int>(std::clamp(std::floor(v), 0.0, double(n - 1)));
  };
  x0 = index(a.x() - margin, grid_.nx - 1);
  y0 = index(a.y() - margin, grid_.ny - 1);
  x1 = index(b.x() + margin + 1, grid_.nx);
  y1 = index(b.y() + margin + 1, grid_.ny);
  // Empty if the rectangle is beyond the grid.
  if (b.x() + margin < -1 || a.x() - margin > grid_.nx) x1 = x0 - 1;
  if (b.y() + margin < -1 || a.y() - margin > grid_.ny) y1 = y0 - 1;
}

HeightTiles::Bounds HeightTiles::bounds(const Vec2& low, const Vec2& high, int margin) const {
  int x0, y0, x1, y1;
  bool complete;
  range(low, high, margin, x0, y0, x1, y1, complete);
  float least = std::numeric_limits<float>::infinity(), most = -least;
  if (x1 < x0 || y1 < y0) return {least, most, false};
  for (int ty = y0 / kHeightTileSide; ty <= y1 / kHeightTileSide; ++ty) {
    for (int tx = x0 / kHeightTileSide; tx <= x1 / kHeightTileSide; ++tx) {
      const Tile& t = tile(tx, ty);
      const int ax = std::max(x0 - tx * kHeightTileSide, 0),
                bx = std::min(x1 - tx * kHeightTileSide, kHeightTileSide - 1);
      const int ay = std::max(y0 - ty * kHeightTileSide, 0),
                by = std::min(y1 - ty * kHeightTileSide, kHeightTileSide - 1);
      // A looser bound is quick and safe.
      if (t.complete && (bx - ax) * (by - ay) > kTileBoundsPosts) {
        least = std::min(least, t.low);
        most = std::max(most, t.high);
        continue;
      }
      const int nx = std::min(kHeightTileSide, grid_.nx - tx * kHeightTileSide);
      for (int y = ay; y <= by; ++y) {
        for (int x = ax; x <= bx; ++x) {
          const float z = t.posts[std::size_t(y) * nx + x];
          if (std::isnan(z)) {
            complete = false;
          } else {
            least = std::min(least, z);
            most = std::max(most, z);
          }
        }
      }
    }
  }
  return {least, most, complete};
}

const HeightTiles::Window& HeightTiles::window(const Vec2& low, const Vec2& high) const {
  thread_local Window w;
  w.low = std::numeric_limits<double>::infinity();
  w.high = -w.low;
  int x1, y1;
  range(low, high, 0, w.x0, w.y0, x1, y1, w.complete);
  w.nx = std::max(0, x1 - w.x0 + 1);
  w.ny = std::max(0, y1 - w.y0 + 1);
  w.posts.resize(std::size_t(w.nx) * w.ny);
  for (int y = 0; y < w.ny; ++y) {
    const int gy = w.y0 + y;
    for (int x = 0; x < w.nx;) {  // the posts of one tile at a time
      const int gx = w.x0 + x, in_x = gx % kHeightTileSide;
      const Tile& t = tile(gx / kHeightTileSide, gy / kHeightTileSide);
      const int nx = std::min(kHeightTileSide, grid_.nx - (gx - in_x));
      const int count = std::min(nx - in_x, w.nx - x);
      std::copy_n(&t.posts[std::size_t(gy % kHeightTileSide) * nx + in_x], count,
                  &w.posts[std::size_t(y) * w.nx + x]);
      x += count;
    }
  }
  for (const float z : w.posts) {
    if (std::isnan(z)) {
      w.complete = false;
    } else {
      w.low = std::min<double>(w.low, z);
      w.high = std::max<double>(w.high, z);
    }
  }
  return w;
}

}  // namespace soilvdb::inline v0
