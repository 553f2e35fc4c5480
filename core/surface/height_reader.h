// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights of columns by counts of their samples, kept by tile until the ground changes there.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "core/constants.h"
#include "core/ground/ground_columns.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/ray_pages.h"
#include "soilvdb/height_map.h"

namespace soilvdb::inline v0 {

/// Reads columns of one ground, and keeps them.
class HeightReader {
 public:
  static constexpr double kNoGround = std::numeric_limits<double>::quiet_NaN();
  static constexpr std::size_t kTouched = 3;  // of Tile::layers: is it other than the terrain?
  static_assert(static_cast<std::size_t>(MapLayer::kDug) + 1 == kTouched);
  /// Heights, of the terrain at the middle of columns that are as it was.
  static constexpr std::size_t kSurface = kTouched + 1;

  /// Layers of 8 x 8 columns, in voxels: heights in index space; NaN without ground.
  struct Tile {
    std::uint64_t known = 0;    ///< bits of the columns that are as the ground is
    std::uint64_t surface = 0;  ///< those of them whose kSurface is known
    std::uint64_t initial = 0;  ///< those that were read before anything changed in the tile
    std::array<std::array<double, BaseColumn::kCells>, kSurface + 1> layers;
    bool touched = false;
    bool changed = false;                           ///< ever: else no chunk is here
    std::array<double, BaseColumn::kCells> before;  // heights, once it is touched
  };

  /// A layer over a rectangle of columns: column (x, y) from the first is entry x * ny + y.
  struct Columns {
    Coord2 first, size;
    std::vector<double> values;

    double at(int x, int y) const { return *from(x, y); }
    /// A column, and those behind it along y.
    const double* from(int x, int y) const {
      return &values[static_cast<std::size_t>(x * size.y() + y)];
    }
    /// Four columns around a place of index space: entries (0, 0), (0, 1), (1, 0) and (1, 1).
    struct Quad {
      const double* corner;
      int row;
      double u, v;  ///< of the place, from the first corner

      std::array<double, 4> corners() const {
        return {corner[0], corner[1], corner[row], corner[row + 1]};
      }
    };
    Quad quad(const Vec2& place) const {
      const int low_x = floor_of(place.x()), low_y = floor_of(place.y());
      return {from(low_x - first.x(), low_y - first.y()), size.y(), place.x() - low_x,
              place.y() - low_y};
    }
    /// The layer at a place of index space between columns' middles, whatever else was read; NaN if
    /// the nearest has no ground.
    double between(const Vec2& place) const {
      const Quad quad = this->quad(place);
      return between(quad.corner, quad.u, quad.v);
    }
    double between(const double* corner, double u, double v) const {
      const double *low = corner, *high = corner + size.y();
      const double near = low[0] + v * (low[1] - low[0]), far = high[0] + v * (high[1] - high[0]);
      const double all = near + u * (far - near);
      return std::isnan(all) ? between_some(corner, size.y(), u, v) : all;
    }
    /// Is the layer more than 0 in any of those four columns?
    bool is_any(const Vec2& place) const {
      const std::array<double, 4> corners = quad(place).corners();
      return std::any_of(corners.begin(), corners.end(), [](double value) { return value > 0; });
    }
    /// Columns without ground do not count.
    [[gnu::noinline]] static double between_some(const double* corner, int row, double u,
                                                 double v) {
      const std::array<double, 4> corners = Quad{corner, row, u, v}.corners();
      const double weights[4] = {(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v};
      double sum = 0, whole = 0;
      for (std::size_t n = 0; n < 4; ++n) {
        const bool some = !std::isnan(corners[n]);
        sum += some ? weights[n] * corners[n] : 0;
        whole += some ? weights[n] : 0;
      }
      const std::size_t nearest = 2 * (u >= 0.5) + (v >= 0.5);
      return std::isnan(corners[nearest]) ? kNoGround : sum / whole;
    }
    static int floor_of(double value) {
      const int cut_off = static_cast<int>(value);
      return cut_off - (value < cut_off);
    }
  };

  explicit HeightReader(Ground& ground) : base_(ground), changes_(ground) { changes_.take(); }
  /// @param other of a ground with the same initial terrain
  HeightReader(Ground& ground, const HeightReader& other)
      : base_(is_alike(ground, other.ground()) ? BaseColumns(ground, other.base_)
                                               : BaseColumns(ground)),
        changes_(ground) {
    changes_.take();
  }

  const Ground& ground() const { return base_.ground(); }
  /// To be called before columns are read.
  void refresh() {
    changes_.take(changed_chunks_);
    for (const Coord3& origin : changed_chunks_) {
      const auto known = tiles_.find(plan_key(origin.head<2>()));
      if (known != tiles_.end()) {
        known->second.known = 0;
        known->second.changed = true;
      } else if (knows_changed_) {
        changed_elsewhere_.insert(plan_key(origin.head<2>()));
      }
      if (pages_) pages_->change(origin.head<2>());
    }
  }
  /// To be called before has_changed(), after refresh().
  void find_changed() {
    if (std::exchange(knows_changed_, true)) return;
    for (const Coord3& origin : ground().origins()) {
      const std::uint64_t key = plan_key(origin.head<2>());
      const auto known = tiles_.find(key);
      if (known != tiles_.end())
        known->second.changed = true;
      else
        changed_elsewhere_.insert(key);
    }
  }
  /// Has a tile of columns ever changed? Several threads may ask.
  bool has_changed(const Coord2& tile) const {
    const auto known = tiles_.find(plan_key(tile));
    return known != tiles_.end() ? known->second.changed
                                 : changed_elsewhere_.contains(plan_key(tile));
  }
  /// Of all ground that changed; made by the first call.
  RayPages& pages() {
    if (!pages_) {
      pages_ = std::make_unique<RayPages>();
      for (const Coord3& origin : ground().origins()) pages_->change(origin.head<2>());
    }
    return *pages_;
  }
  /// Reads all tiles of a rectangle of columns.
  void prepare(const Coord2& low, const Coord2& high) {
    const Coord2 first = floor_to(low, kChunkSide), last = floor_to(high, kChunkSide);
    const auto tiles = ((last - first) / kChunkSide + Coord2::Ones()).cast<double>().prod();
    if (tiles > static_cast<double>(kMaxBaseColumns))
      throw std::invalid_argument("an area must have at most " + std::to_string(kMaxBaseColumns) +
                                  " times 8 x 8 voxels");
    base_.make_room(static_cast<std::size_t>(tiles));
    if (tiles_.size() + static_cast<std::size_t>(tiles) > kMaxHeightTiles) forget_tiles();
    constexpr std::uint64_t kAll = ~std::uint64_t{0};
    for (int cx = first.x(); cx <= last.x(); cx += kChunkSide)
      for (int cy = first.y(); cy <= last.y(); cy += kChunkSide)
        find_surface(kept({cx, cy}, kAll), {cx, cy}, kAll);
  }
  /// @param layer of Tile @param ceiling highest cell that is looked at
  void read(const Coord2& first, const Coord2& size, std::size_t layer, int ceiling, Columns& out) {
    out.first = first;
    out.size = size;
    out.values.resize(static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y()));
    const Coord2 end = first + size;
    for (int cx = floor_to(first.x(), kChunkSide); cx < end.x(); cx += kChunkSide) {
      for (int cy = floor_to(first.y(), kChunkSide); cy < end.y(); cy += kChunkSide) {
        const int low_y = std::max(cy, first.y()), end_y = std::min(cy + kChunkSide, end.y());
        const int low_x = std::max(cx, first.x()), end_x = std::min(cx + kChunkSide, end.x());
        std::uint64_t wanted = 0;
        for (int x = low_x; x < end_x; ++x)
          wanted |= ((std::uint64_t{1} << (end_y - low_y)) - 1)
                    << ((x - cx) * kChunkSide + low_y - cy);
        Tile below;
        if (ceiling != kNoCeiling) read(below, {cx, cy}, ceiling, wanted);
        Tile& tile = ceiling == kNoCeiling ? kept({cx, cy}, wanted) : below;
        if (layer == kSurface) find_surface(tile, {cx, cy}, wanted);
        const double* from = tile.layers[layer].data();
        for (int x = low_x; x < end_x; ++x)
          std::copy_n(
              from + (x - cx) * kChunkSide + low_y - cy, end_y - low_y,
              out.values.begin() + std::ptrdiff_t{x - first.x()} * size.y() + low_y - first.y());
      }
    }
  }

  /// Reads kSurface of one tile: of one that never changed only the terrain's heights, if there is
  /// ground all over it. To be called after find_changed().
  void read_surface(const Coord2& tile, Columns& out) {
    if (has_changed(tile) || !read_terrain(tile, out))
      read(tile, Coord2::Constant(kChunkSide), kSurface, kNoCeiling, out);
  }

  /// Cells of a map along an axis as columns: the first, and how many.
  struct Overlap {
    double low, high;
    int first, count;

    /// How much of a column, from the first on, is inside.
    double share(int column) const {
      const double x = first + column;
      return std::min(high, x + 1) - std::max(low, x);
    }
  };

  Columns columns, changed;  // scratch

 private:
  static bool is_alike(const Ground& a, const Ground& b) {
    return a.voxel_size_m() == b.voxel_size_m() && a.origin() == b.origin();
  }

  void forget_tiles() {
    for (const auto& [key, tile] : tiles_)
      if (tile.changed) changed_elsewhere_.insert(key);
    tiles_.clear();
  }
  Tile& kept(const Coord2& cell, std::uint64_t wanted) {
    if (tiles_.size() >= kMaxHeightTiles && !tiles_.contains(plan_key(cell))) forget_tiles();
    const auto [at, is_new] = tiles_.try_emplace(plan_key(cell));
    Tile& tile = at->second;
    if (is_new) tile.changed = changed_elsewhere_.contains(plan_key(cell));
    if ((wanted & ~tile.known) != 0) read(tile, cell, kNoCeiling, wanted & ~tile.known);
    return tile;
  }
  void read(Tile& tile, const Coord2& cell, int ceiling, std::uint64_t wanted) {
    const int cx = cell.x(), cy = cell.y();
    if (!tile.touched && is_touched(base_, cx, cy)) {
      // Counted alike, so that what nobody touched is as it was.
      ColumnTile initial;
      if (tile.initial != ~std::uint64_t{0})
        initial = read_tile_exactly(base_, cx, cy, ceiling, true, ~tile.initial);
      for (std::size_t i = 0; i < BaseColumn::kCells; ++i)
        tile.before[i] = (tile.initial >> i & 1) != 0 ? tile.layers[0][i] : initial.columns[i].top;
      tile.touched = true;
    }
    const ColumnTile now = read_tile_exactly(base_, cx, cy, ceiling, !tile.touched, wanted);
    const std::uint64_t fresh = now.read & ~tile.known;
    for (std::uint64_t left = fresh; left != 0; left &= left - 1) {
      const auto i = static_cast<std::size_t>(std::countr_zero(left));
      const GroundColumn& c = now.columns[i];
      const double before = tile.touched ? tile.before[i] : c.top;
      const double values[] = {c.top, c.top - c.bank, before - c.top,
                               c.top != before || c.bank != c.top ? 1.0 : 0.0};
      for (std::size_t n = 0; n < kSurface; ++n)
        tile.layers[n][i] = c.known ? values[n] : kNoGround;
    }
    tile.known |= fresh;
    tile.surface &= ~fresh;
    if (!tile.touched) tile.initial |= fresh;
  }
  /// Height of the terrain at the middle of a column.
  std::optional<double> terrain_height(const Coord2& cell) const {
    const double h = ground().voxel_size_m();
    const Vec2 at = ground().origin().head<2>() + h * cell.cast<double>();
    const std::optional<double> height = ground().terrain().height(at.x(), at.y());
    if (!height) return {};
    return (*height - ground().origin().z()) / h;
  }
  /// @return is there ground all over the tile?
  bool read_terrain(const Coord2& tile, Columns& out) const {
    out.first = tile;
    out.size = Coord2::Constant(kChunkSide);
    out.values.resize(BaseColumn::kCells);
    double low = std::numeric_limits<double>::infinity();
    for (int i = 0; i < BaseColumn::kCells; ++i) {
      const auto height = terrain_height(tile + Coord2(i / kChunkSide, i % kChunkSide));
      if (!height) return false;
      out.values[static_cast<std::size_t>(i)] = *height;
      low = std::min(low, *height);
    }
    const Vec3 corner(tile.x() - 0.5, tile.y() - 0.5, low - 1);
    return ground().terrain().has_data(
        {ground().world_from_index(corner),
         ground().world_from_index(corner + Vec3(kChunkSide, kChunkSide, 1))});
  }
  void find_surface(Tile& tile, const Coord2& cell, std::uint64_t wanted) {
    for (std::uint64_t left = wanted & ~tile.surface; left != 0; left &= left - 1) {
      const int i = std::countr_zero(left);
      const auto n = static_cast<std::size_t>(i);
      double& z = tile.layers[kSurface][n];
      z = tile.layers[0][n];
      if (tile.layers[kTouched][n] != 0) continue;
      z = terrain_height(cell + Coord2(i / kChunkSide, i % kChunkSide)).value_or(z);
    }
    tile.surface |= wanted;
  }

  BaseColumns base_;
  ChangeFollower changes_;
  std::vector<Coord3> changed_chunks_;  // scratch
  std::unordered_map<std::uint64_t, Tile, PlanHash> tiles_;
  std::unordered_set<std::uint64_t, PlanHash> changed_elsewhere_;  // tiles that are not kept
  bool knows_changed_ = false;
  std::unique_ptr<RayPages> pages_;  // null until rays were cast

 public:
  std::vector<Overlap> of_rows, of_columns;  // scratch
};

}  // namespace soilvdb::inline v0
