// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/height_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <vector>

#include "core/constants.h"
#include "core/ground/ground_columns.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::inline v0 {
namespace {

constexpr double kNoGroundHere = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kTouched = 3;  // of Tile::layers: is it other than the terrain? 0 or 1
static_assert(static_cast<std::size_t>(MapLayer::kDug) + 1 == kTouched);

/// Cells of a map along an axis as columns of voxels: the first, and how much of each is inside.
struct Overlap {
  int first = 0;
  std::vector<double> shares;
};

Overlap overlap(double low, double high) {
  const double first = std::floor(low + kSameCell), last = std::ceil(high - kSameCell);
  Overlap found{static_cast<int>(first), {}};
  for (double x = first; x < last; ++x)
    found.shares.push_back(std::min(high, x + 1) - std::max(low, x));
  return found;
}

void require(bool holds, const std::string& why) {
  if (!holds) throw std::invalid_argument(why);
}

}  // namespace

/// Reads columns of one ground, and keeps them.
class HeightMap::Reader {
 public:
  /// Layers of 8 x 8 columns, in voxels: heights in index space; NaN without ground.
  struct Tile {
    bool stale = true;
    std::array<std::array<double, BaseColumn::kCells>, kTouched + 1> layers;
    std::unique_ptr<std::array<double, BaseColumn::kCells>> before;  // heights, once it is touched
  };

  /// A layer over a rectangle of columns: column (x, y) from the first is entry x * ny + y.
  struct Columns {
    Coord2 first, size;
    std::vector<double> values;

    double at(int x, int y) const { return values[static_cast<std::size_t>(x * size.y() + y)]; }
    /// The layer at a place of index space between columns' middles, whatever else was read; NaN if
    /// the nearest has no ground.
    double between(const Vec2& place) const {
      const Vec2 low = place.array().floor();
      const int x = static_cast<int>(low.x()) - first.x(),
                y = static_cast<int>(low.y()) - first.y();
      const double u = place.x() - low.x(), v = place.y() - low.y();
      const double corners[4] = {at(x, y), at(x, y + 1), at(x + 1, y), at(x + 1, y + 1)};
      const double weights[4] = {(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v};
      double sum = 0, whole = 0;
      for (int n = 0; n < 4; ++n) {
        if (std::isnan(corners[n])) continue;
        sum += weights[n] * corners[n];
        whole += weights[n];
      }
      const int nearest = 2 * (u >= 0.5) + (v >= 0.5);
      return std::isnan(corners[nearest]) ? kNoGroundHere : sum / whole;
    }
  };

  explicit Reader(Ground& ground) : base_(ground), changes_(ground) { changes_.take(); }
  /// @param other of a ground with the same initial terrain
  Reader(Ground& ground, const Reader& other)
      : base_(is_alike(ground, other.ground()) ? BaseColumns(ground, other.base_)
                                               : BaseColumns(ground)),
        changes_(ground) {
    changes_.take();
  }

  const Ground& ground() const { return base_.ground(); }
  /// To be called before columns are read.
  void refresh() {
    for (const Coord3& origin : changes_.take()) {
      const auto known = tiles_.find(key(origin.head<2>()));
      if (known != tiles_.end()) known->second.stale = true;
    }
  }
  /// @param layer of Tile @param ceiling highest cell that is looked at
  void read(const Coord2& first, const Coord2& size, std::size_t layer, int ceiling, Columns& out) {
    out.first = first;
    out.size = size;
    out.values.resize(static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y()));
    const Coord2 end = first + size;
    for (int cx = floor_to(first.x(), kChunkSide); cx < end.x(); cx += kChunkSide) {
      for (int cy = floor_to(first.y(), kChunkSide); cy < end.y(); cy += kChunkSide) {
        Tile below;
        if (ceiling != kNoCeiling) read(below, {cx, cy}, ceiling);
        const Tile& tile = ceiling == kNoCeiling ? kept({cx, cy}) : below;
        const double* from = tile.layers[layer].data();
        const int low_y = std::max(cy, first.y()), end_y = std::min(cy + kChunkSide, end.y());
        for (int x = std::max(cx, first.x()); x < std::min(cx + kChunkSide, end.x()); ++x)
          std::copy_n(
              from + (x - cx) * kChunkSide + low_y - cy, end_y - low_y,
              out.values.begin() + std::ptrdiff_t{x - first.x()} * size.y() + low_y - first.y());
      }
    }
  }

  Columns columns, changed;  // scratch

 private:
  static bool is_alike(const Ground& a, const Ground& b) {
    return a.voxel_size_m() == b.voxel_size_m() && a.origin() == b.origin();
  }
  static std::uint64_t key(const Coord2& cell) {
    return std::uint64_t{static_cast<std::uint32_t>(cell.x())} << 32 |
           static_cast<std::uint32_t>(cell.y());
  }
  struct Hash {
    std::size_t operator()(std::uint64_t key) const { return key * 0x9e3779b97f4a7c15u >> 20; }
  };

  const Tile& kept(const Coord2& cell) {
    if (tiles_.size() >= kMaxHeightTiles && !tiles_.contains(key(cell))) tiles_.clear();
    Tile& tile = tiles_[key(cell)];
    if (tile.stale) read(tile, cell, kNoCeiling);
    return tile;
  }
  void read(Tile& tile, const Coord2& cell, int ceiling) {
    const int cx = cell.x(), cy = cell.y();
    const bool touched = is_touched(base_, cx, cy);
    if (touched && !tile.before) {
      // Counted alike, so that what nobody touched is as it was.
      const ColumnTile initial = read_tile_exactly(base_, cx, cy, ceiling, true);
      tile.before = std::make_unique<std::array<double, BaseColumn::kCells>>();
      for (std::size_t i = 0; i < BaseColumn::kCells; ++i)
        (*tile.before)[i] = initial.columns[i].top;
    }
    const ColumnTile now = read_tile_exactly(base_, cx, cy, ceiling, !touched);
    for (std::size_t i = 0; i < BaseColumn::kCells; ++i) {
      const GroundColumn& c = now.columns[i];
      const double before = touched ? (*tile.before)[i] : c.top;
      const double values[] = {c.top, c.top - c.bank, before - c.top,
                               c.top != before || c.bank != c.top ? 1.0 : 0.0};
      for (std::size_t n = 0; n < tile.layers.size(); ++n)
        tile.layers[n][i] = c.known ? values[n] : kNoGroundHere;
    }
    tile.stale = false;
  }

  BaseColumns base_;
  ChangeFollower changes_;
  std::unordered_map<std::uint64_t, Tile, Hash> tiles_;
};

MapGrid MapGrid::around(const Vec2& middle_m, double cell_m, int nx, int ny, const Pose* turn) {
  MapGrid grid{{0, 0}, cell_m, nx, ny, {1, 0}};
  if (turn != nullptr) {
    // The lip keeps its way while the bucket curls; where it stands upright the mouth does.
    const Vec3 lip = turn->rotation * Vec3::UnitY(), mouth = turn->rotation * Vec3::UnitX();
    const Vec2 ahead(lip.y(), -lip.x());
    grid.along = (ahead.norm() > 0.5 ? ahead : Vec2(mouth.head<2>())).normalized();
  }
  grid.first_m = middle_m - (grid.middle_m(ny - 1, nx - 1) - grid.first_m) / 2;
  return grid;
}

Vec2 MapGrid::middle_m(int i, int j) const {
  return first_m + cell_m * (j * along + i * Vec2(-along.y(), along.x()));
}

HeightMap::HeightMap(Ground& ground) : reader_(std::make_unique<Reader>(ground)) {}
HeightMap::HeightMap(Ground& ground, const HeightMap& other)
    : reader_(std::make_unique<Reader>(ground, *other.reader_)) {}
HeightMap::HeightMap(HeightMap&&) noexcept = default;
HeightMap& HeightMap::operator=(HeightMap&&) noexcept = default;
HeightMap::~HeightMap() = default;

void HeightMap::at(std::span<const Vec2> xy_m, std::span<double> heights_m) {
  require(heights_m.size() >= xy_m.size(), "there must be room for as many heights as places");
  Reader& reader = *reader_;
  const Ground& ground = reader.ground();
  reader.refresh();
  const auto index = [&](const Vec2& xy) {
    return Vec2((xy - ground.origin().head<2>()) / ground.voxel_size_m());
  };
  const auto is_near = [](const Vec2& at) {
    return at.allFinite() && at.cwiseAbs().maxCoeff() < kMaxIndex;
  };
  const auto look = [&](const Vec2& xy) {
    if (!xy.allFinite()) return kNoGroundHere;
    const Vec2 at = index(xy);
    const bool near = is_near(at);
    // What nobody touched is as high as the terrain, which counts only come near.
    if (!near || !(reader.changed.between(at) > 0))
      if (const auto z = ground.terrain().height(xy.x(), xy.y())) return *z;
    return near ? ground.origin().z() + ground.voxel_size_m() * reader.columns.between(at)
                : kNoGroundHere;
  };
  const auto read = [&](const Vec2& low, const Vec2& high) {
    const Coord2 first = low.array().floor().matrix().cast<int>();
    const Coord2 last = high.array().floor().matrix().cast<int>();
    const Coord2 size = last - first + Coord2::Constant(2);
    reader.read(first, size, static_cast<std::size_t>(MapLayer::kHeight), kNoCeiling,
                reader.columns);
    reader.read(first, size, kTouched, kNoCeiling, reader.changed);
  };
  Eigen::AlignedBox2d box;
  for (const Vec2& xy : xy_m)
    if (const Vec2 at = index(xy); is_near(at)) box.extend(at);
  // All at once, unless most of what is between them were read in vain.
  const bool at_once =
      !box.isEmpty() &&
      (box.sizes() + Vec2(2, 2)).prod() <
          std::min<double>(kMapPartColumns, kMapPointColumns * static_cast<double>(xy_m.size()));
  if (at_once) read(box.min(), box.max());
  for (std::size_t i = 0; i < xy_m.size(); ++i) {
    if (const Vec2 at = index(xy_m[i]); !at_once && is_near(at)) read(at, at);
    heights_m[i] = look(xy_m[i]);
  }
}

template <typename T>
void HeightMap::fill(const MapGrid& given, MapLayer layer, std::span<T> out,
                     std::optional<double> ceiling_m) {
  MapGrid grid = given;
  require(given.along.allFinite() && std::abs(given.along.norm() - 1) < kMaxUnitError,
          "a map's axis must be a direction of unit length");
  grid.along.normalize();
  for (const Vec2& axis : {Vec2(1, 0), Vec2(0, 1), Vec2(-1, 0), Vec2(0, -1)})
    if ((grid.along - axis).norm() < kSameAxis) grid.along = axis;
  Reader& reader = *reader_;
  const Ground& ground = reader.ground();
  const double h = ground.voxel_size_m(), side = grid.cell_m / h;
  require(grid.nx > 0 && grid.ny > 0, "a map must have a cell or more");
  require(out.size() == static_cast<std::size_t>(grid.nx) * static_cast<std::size_t>(grid.ny),
          "there must be room for the map's cells");
  require(side >= kMinMapCell && side * side <= kMapPartColumns,
          "a map's cells must be from a thousandth of a voxel to " +
              std::to_string(static_cast<int>(std::sqrt(kMapPartColumns))) + " voxels wide");
  require(grid.first_m.allFinite(), "a map's place must be numbers");
  for (const int i : {0, grid.ny - 1})
    for (const int j : {0, grid.nx - 1})
      require(((grid.middle_m(i, j) - ground.origin().head<2>()) / h).cwiseAbs().maxCoeff() <
                  kMaxIndex - side,
              "a map must be within 2^23 voxels of the site's origin");
  require(!ceiling_m || std::isfinite(*ceiling_m), "a map's ceiling must be a number");
  int ceiling = kNoCeiling;
  if (ceiling_m) {
    const double z = std::clamp((*ceiling_m - ground.origin().z()) / h, -kMaxIndex, kMaxIndex);
    ceiling = static_cast<int>(std::floor(z + 0.5 + kSameCell)) - 1;
  }
  reader.refresh();
  const double zero = layer == MapLayer::kHeight ? ground.origin().z() : 0;
  const auto metres = [&](double cells) { return static_cast<T>(zero + h * cells); };
  // Middle of a cell in columns, of which column k covers [k, k + 1].
  const auto place = [&](int i, int j) {
    return Vec2((grid.middle_m(i, j) - ground.origin().head<2>()) / h + Vec2(0.5, 0.5));
  };
  const bool turned = grid.along.x() != 0 && grid.along.y() != 0;
  const bool upright = !turned && grid.along.x() == 0;  // rows of the map are along the world's y
  const int points = turned ? static_cast<int>(std::ceil(side - kSameCell)) : 0;
  const Vec2 step_x = side * grid.along, step_y(-step_x.y(), step_x.x());
  // So many cells at a time that their columns are few enough.
  const int most = std::max(1, static_cast<int>(std::sqrt(kMapPartColumns) / (1.5 * side + 1)));
  std::vector<Overlap> of_rows, of_columns;
  for (int i0 = 0; i0 < grid.ny; i0 += most) {
    for (int j0 = 0; j0 < grid.nx; j0 += most) {
      const int i1 = std::min(i0 + most, grid.ny), j1 = std::min(j0 + most, grid.nx);
      Eigen::AlignedBox2d box;
      for (const int i : {i0, i1 - 1})
        for (const int j : {j0, j1 - 1})
          for (const double u : {-0.5, 0.5})
            for (const double v : {-0.5, 0.5}) box.extend(place(i, j) + u * step_x + v * step_y);
      const Coord2 first = box.min().array().floor().matrix().template cast<int>() - Coord2::Ones();
      const Coord2 end = box.max().array().ceil().matrix().template cast<int>() + Coord2::Ones();
      Reader::Columns& columns = reader.columns;
      reader.read(first, end - first, static_cast<std::size_t>(layer), ceiling, columns);
      const auto overlaps = [&](bool rows, std::vector<Overlap>& all) {
        const int axis = rows == upright ? 0 : 1;
        all.clear();
        for (int n = rows ? i0 : j0; n < (rows ? i1 : j1) && !turned; ++n) {
          const double at = place(rows ? n : 0, rows ? 0 : n)[axis] - first[axis];
          all.push_back(overlap(at - side / 2, at + side / 2));
        }
      };
      overlaps(true, of_rows);
      overlaps(false, of_columns);
      for (int j = j0; j < j1; ++j) {
        for (int i = i0; i < i1; ++i) {
          double sum = 0, whole = 0;
          const auto add = [&](double value, double share) {
            if (std::isnan(value)) return;
            sum += share * value;
            whole += share;
          };
          if (turned) {
            const Vec2 middle = place(i, j) - Vec2(0.5, 0.5);
            for (int a = 0; a < points; ++a)
              for (int b = 0; b < points; ++b)
                add(columns.between(middle + ((a + 0.5) / points - 0.5) * step_x +
                                    ((b + 0.5) / points - 0.5) * step_y),
                    1);
          } else {
            const Overlap& row = of_rows[static_cast<std::size_t>(i - i0)];
            const Overlap& column = of_columns[static_cast<std::size_t>(j - j0)];
            const Overlap &in_x = upright ? row : column, &in_y = upright ? column : row;
            for (std::size_t a = 0; a < in_x.shares.size(); ++a)
              for (std::size_t b = 0; b < in_y.shares.size(); ++b)
                add(columns.at(in_x.first + static_cast<int>(a), in_y.first + static_cast<int>(b)),
                    in_x.shares[a] * in_y.shares[b]);
          }
          out[static_cast<std::size_t>(i) * static_cast<std::size_t>(grid.nx) +
              static_cast<std::size_t>(j)] =
              whole > 0 ? metres(sum / whole) : std::numeric_limits<T>::quiet_NaN();
        }
      }
    }
  }
}

void HeightMap::map(const MapGrid& grid, MapLayer layer, std::span<double> out,
                    std::optional<double> ceiling_m) {
  fill(grid, layer, out, ceiling_m);
}
void HeightMap::map(const MapGrid& grid, MapLayer layer, std::span<float> out,
                    std::optional<double> ceiling_m) {
  fill(grid, layer, out, ceiling_m);
}

}  // namespace soilvdb::inline v0
