// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/height_map.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/height_reader.h"

namespace soilvdb::inline v0 {
namespace {

/// Points that a thread looks at at a time. With fewer, tasks take time.
constexpr std::size_t kPointsPerTask = 1 << 12;

/// In place of a height that isn't known yet: a NaN that no computation makes.
constexpr std::uint64_t kToReadBits = 0x7ff8'0000'5011'5011;
constexpr double kToRead = std::bit_cast<double>(kToReadBits);
bool is_to_read(double height) { return std::bit_cast<std::uint64_t>(height) == kToReadBits; }

using Overlap = HeightReader::Overlap;

Overlap overlap(double low, double high) {
  const auto first = static_cast<int>(std::floor(low + kSameCell));
  return {low, high, first, static_cast<int>(std::ceil(high - kSameCell)) - first};
}

void require(bool holds, const char* why) {
  if (!holds) throw std::invalid_argument(why);
}

/// The highest cell below a ceiling, and its top, m.
struct Ceiling {
  int cell = kNoCeiling;
  double top_m = std::numeric_limits<double>::infinity();

  Ceiling(const std::optional<double>& ceiling_m, const Ground& ground) {
    if (!ceiling_m) return;
    require(std::isfinite(*ceiling_m), "a ceiling must be a number");
    const double h = ground.voxel_size_m(), z = (*ceiling_m - ground.origin().z()) / h;
    const double highest = std::floor(z + 0.5 + kSameCell) - 1;
    cell = static_cast<int>(std::clamp(highest, -kMaxIndex, kMaxIndex));
    top_m = ground.origin().z() + h * (highest + 0.5);
  }
};

/// Columns of a rectangle that is turned any way, and of their margins.
double columns_of(double width, double height) {
  const double side = std::hypot(width, height) + 4;
  return side * side;
}

}  // namespace

void LookResult::check() const {
  if (fault == Fault::kBadRequest) throw std::invalid_argument(why);
  if (fault == Fault::kFailed) throw std::runtime_error(why);
}

/// That of the exception that is being handled.
LookResult LookResult::of_exception() noexcept {
  const auto because = [](Fault kind, const char* reason) {
    LookResult result{kind, {}};
    try {
      result.why = reason;
    } catch (const std::bad_alloc&) {  // there is no memory for the reason
    }
    return result;
  };
  try {
    throw;
  } catch (const std::invalid_argument& e) {
    return because(Fault::kBadRequest, e.what());
  } catch (const std::bad_alloc&) {
    return because(Fault::kFailed, "out of memory");
  } catch (const std::exception& e) {
    return because(Fault::kFailed, e.what());
  } catch (...) {
    return because(Fault::kFailed, "an unknown error");
  }
}

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

HeightMap::HeightMap(Ground& ground) : reader_(std::make_unique<HeightReader>(ground)) {}
HeightMap::HeightMap(Ground& ground, const HeightMap& other)
    : reader_(std::make_unique<HeightReader>(ground, *other.reader_)) {}
HeightMap::HeightMap(HeightMap&&) noexcept = default;
HeightMap& HeightMap::operator=(HeightMap&&) noexcept = default;
HeightMap::~HeightMap() = default;

LookResult HeightMap::prepare(const Eigen::AlignedBox2d& area_m) noexcept {
  return LookResult::of([&] {
    const Ground& ground = reader_->ground();
    const auto column = [&](const Vec2& xy) -> Coord2 {
      const Vec2 at = (xy - ground.origin().head<2>()) / ground.voxel_size_m();
      require(at.allFinite() && at.cwiseAbs().maxCoeff() < kMaxIndex,
              "an area must be within 2^23 voxels of the site's origin");
      return (at + Vec2(0.5, 0.5)).array().floor().matrix().cast<int>();
    };
    require(!area_m.isEmpty(), "an area must have its corners in order");
    reader_->refresh();
    // Looks in it also read columns beside it.
    reader_->prepare(column(area_m.min()) - Coord2::Ones(), column(area_m.max()) + Coord2::Ones());
  });
}

LookResult HeightMap::at(std::span<const Vec2> xy_m, std::span<double> heights_m,
                         std::optional<double> ceiling_m) noexcept {
  const std::span<double> out = heights_m.first(std::min(xy_m.size(), heights_m.size()));
  const auto look = [&] {
    require(heights_m.size() >= xy_m.size(), "there must be room for as many heights as places");
    fill_at(xy_m, out, ceiling_m);
  };
  return LookResult::of(look, out);
}

LookResult HeightMap::cast(std::span<const Vec3> origins_m, std::span<const Vec3> directions,
                           std::span<double> ranges_m) noexcept {
  return LookResult::of([&] { fill_ranges(origins_m, directions, ranges_m); }, ranges_m);
}

void HeightMap::fill_at(std::span<const Vec2> xy_m, std::span<double> heights_m,
                        std::optional<double> ceiling_m) {
  HeightReader& reader = *reader_;
  const Ground& ground = reader.ground();
  const Ceiling ceiling(ceiling_m, ground);
  reader.refresh();
  const auto index = [&](const Vec2& xy) {
    return Vec2((xy - ground.origin().head<2>()) / ground.voxel_size_m());
  };
  const auto is_near = [](const Vec2& at) {
    return at.allFinite() && at.cwiseAbs().maxCoeff() < kMaxIndex;
  };
  // What nobody touched is as high as the terrain. Of many places it is not read; of a few it is,
  // so that they are known, and need no memory, when it changes.
  const bool are_many = xy_m.size() > kPointsPerTask;
  if (are_many) reader.find_changed();
  const auto untouched = [&](const Vec2& xy) {
    if (!xy.allFinite()) return HeightReader::kNoGround;
    if (!are_many) return kToRead;
    if (const Vec2 at = index(xy); is_near(at)) {
      const Coord2 low = at.array().floor().matrix().cast<int>();
      const Coord2 first = floor_to(low, kChunkSide);
      const Coord2 last = floor_to(Coord2(low + Coord2::Ones()), kChunkSide);
      for (int x = first.x(); x <= last.x(); x += kChunkSide)
        for (int y = first.y(); y <= last.y(); y += kChunkSide)
          if (reader.has_changed({x, y})) return kToRead;
    }
    const auto z = ground.terrain().height(xy.x(), xy.y());
    return z && *z <= ceiling.top_m ? *z : kToRead;
  };
  const auto look = [&](const Vec2& xy) {
    const Vec2 at = index(xy);
    const bool changed = is_near(at) && reader.changed.is_any(at);
    double counted = changed ? reader.columns.between(at) : HeightReader::kNoGround;
    // What nobody touched is as high as the terrain, which counts only come near.
    if (std::isnan(counted)) {
      const auto z = ground.terrain().height(xy.x(), xy.y());
      if (z && *z <= ceiling.top_m) return *z;
      if (is_near(at))
        counted = reader.columns.between(at);
      else if (z)
        return ceiling.top_m;
    }
    return ground.origin().z() + ground.voxel_size_m() * counted;
  };
  const auto read = [&](const Vec2& low, const Vec2& high) {
    const Coord2 first = low.array().floor().matrix().cast<int>();
    const Coord2 last = high.array().floor().matrix().cast<int>();
    const Coord2 size = last - first + Coord2::Constant(2);
    reader.read(first, size, static_cast<std::size_t>(MapLayer::kHeight), ceiling.cell,
                reader.columns);
    reader.read(first, size, HeightReader::kTouched, ceiling.cell, reader.changed);
  };
  const auto each = [&](const auto& f) {
    const std::size_t tasks = (xy_m.size() + kPointsPerTask - 1) / kPointsPerTask;
    const auto run = [&](std::size_t task) {
      const std::size_t end = std::min((task + 1) * kPointsPerTask, xy_m.size());
      for (std::size_t i = task * kPointsPerTask; i < end; ++i) f(i);
    };
    if (tasks == 1) return run(0);
    tbb::parallel_for(std::size_t{0}, tasks, run);
  };
  each([&](std::size_t i) { heights_m[i] = untouched(xy_m[i]); });
  Eigen::AlignedBox2d box;
  std::size_t count = 0;
  for (std::size_t i = 0; i < xy_m.size(); ++i) {
    if (!is_to_read(heights_m[i])) continue;
    ++count;
    if (const Vec2 at = index(xy_m[i]); is_near(at)) box.extend(at);
  }
  // All at once, unless most of what is between them were read in vain.
  const double most_columns =
      std::min<double>(kMapPartColumns, kMapPointColumns * static_cast<double>(count));
  for (HeightReader::Columns* columns : {&reader.columns, &reader.changed})
    columns->values.reserve(static_cast<std::size_t>(most_columns));
  const bool at_once = !box.isEmpty() && (box.sizes() + Vec2(3, 3)).prod() < most_columns;
  if (at_once) {
    read(box.min(), box.max());
    return each([&](std::size_t i) {
      if (is_to_read(heights_m[i])) heights_m[i] = look(xy_m[i]);
    });
  }
  for (std::size_t i = 0; i < xy_m.size(); ++i) {
    if (!is_to_read(heights_m[i])) continue;
    if (const Vec2 at = index(xy_m[i]); is_near(at)) read(at, at);
    heights_m[i] = look(xy_m[i]);
  }
}

namespace {

/// Columns::between() at the places of a line, in m, but NaN where one of four columns has no
/// ground. Places are rounded as the corners of what was read: none may be outside.
/// @return is there such a column?
SOILVDB_FOR_CPUS bool read_line(const HeightReader::Columns& columns, const Vec2& first,
                                const Vec2& along, const Vec2& aside, double level, double h,
                                std::span<double> out) {
  const double x0 = first.x(), y0 = first.y(), x_step = along.x(), y_step = along.y();
  const double x_aside = aside.x(), y_aside = aside.y();
  const int row = columns.size.y(), count = static_cast<int>(out.size());
  const int first_x = columns.first.x(), first_y = columns.first.y();
  const double *const near = columns.values.data(), *const far = near + row;
  constexpr int kAtOnce = 64;
  std::array<double, kAtOnce> u, v, heights;
  std::array<int, kAtOnce> places;
  int unknown = 0;
  for (int begin = 0; begin < count; begin += kAtOnce) {
    const int n = std::min(kAtOnce, count - begin);
    for (int k = 0; k < n; ++k) {
      const double x = x0 + (begin + k) * x_step + x_aside, y = y0 + (begin + k) * y_step + y_aside;
      const int cut_x = static_cast<int>(x), cut_y = static_cast<int>(y);
      const int low_x = cut_x - (x < cut_x), low_y = cut_y - (y < cut_y);
      u[k] = x - low_x;
      v[k] = y - low_y;
      places[k] = (low_x - first_x) * row + low_y - first_y;
    }
    for (int k = 0; k < n; ++k) {
      const double a = near[places[k]] + v[k] * (near[places[k] + 1] - near[places[k]]);
      const double b = far[places[k]] + v[k] * (far[places[k] + 1] - far[places[k]]);
      heights[k] = level + h * (a + u[k] * (b - a));
      unknown += heights[k] != heights[k];
    }
    std::copy_n(heights.begin(), n, out.begin() + begin);
  }
  return unknown > 0;
}

}  // namespace

void HeightMap::lines(const Vec2& first_m, const Vec2& along_m, int count, const Vec2& across_m,
                      int lines, std::span<double> heights_m) {
  HeightReader& reader = *reader_;
  const Ground& ground = reader.ground();
  const double h = ground.voxel_size_m();
  const Vec2 first = (first_m - ground.origin().head<2>()) / h, along = along_m / h,
             across = across_m / h;
  Eigen::AlignedBox2d box;
  for (const int i : {0, count - 1})
    for (const int k : {0, lines - 1}) box.extend(first + i * along + k * across);
  require(box.min().allFinite() && box.max().allFinite() &&
              box.min().cwiseAbs().maxCoeff() < kMaxIndex &&
              box.max().cwiseAbs().maxCoeff() < kMaxIndex,
          "points must be within 2^23 voxels of the site's origin");
  require((box.sizes() + Vec2(2, 2)).prod() < kMostLineColumns,
          "the lines span too many columns; take larger voxels or fewer lines");
  reader.refresh();
  const double long_way = along.norm() * count, wide_way = across.norm() * lines;
  reader.columns.values.reserve(static_cast<std::size_t>(columns_of(long_way, wide_way)));
  const Coord2 low = box.min().array().floor().matrix().cast<int>();
  const Coord2 size = box.max().array().floor().matrix().cast<int>() - low + Coord2::Constant(2);
  reader.read(low, size, HeightReader::kSurface, kNoCeiling, reader.columns);
  const HeightReader::Columns& columns = reader.columns;
  const double level = ground.origin().z();
  for (int k = 0; k < lines; ++k) {
    const Vec2 aside = k * across;
    const auto length = static_cast<std::size_t>(count);
    const std::span<double> out = heights_m.subspan(static_cast<std::size_t>(k) * length, length);
    if (!read_line(columns, first, along, aside, level, h, out)) continue;
    for (int i = 0; i < count; ++i) {
      double& z = out[static_cast<std::size_t>(i)];
      if (std::isnan(z)) z = level + h * columns.between(first + i * along + aside);
    }
  }
}

template <typename T>
void HeightMap::fill(const MapGrid& given, MapLayer layer, std::span<T> out,
                     std::optional<double> ceiling_m, const InitialTerrain* design) {
  MapGrid grid = given;
  require(given.along.allFinite() && std::abs(given.along.norm() - 1) < kMaxUnitError,
          "a map's axis must be a direction of unit length");
  grid.along.normalize();
  for (const Vec2& axis : {Vec2(1, 0), Vec2(0, 1), Vec2(-1, 0), Vec2(0, -1)})
    if ((grid.along - axis).norm() < kSameAxis) grid.along = axis;
  HeightReader& reader = *reader_;
  const Ground& ground = reader.ground();
  const double h = ground.voxel_size_m(), side = grid.cell_m / h;
  require(grid.nx > 0 && grid.ny > 0, "a map must have a cell or more");
  require(out.size() == static_cast<std::size_t>(grid.nx) * static_cast<std::size_t>(grid.ny),
          "there must be room for the map's cells");
  if (!(side >= kMinMapCell && side * side <= kMapPartColumns))
    throw std::invalid_argument("a map's cells must be from a thousandth of a voxel to " +
                                std::to_string(static_cast<int>(std::sqrt(kMapPartColumns))) +
                                " voxels wide");
  require(grid.first_m.allFinite(), "a map's place must be numbers");
  for (const int i : {0, grid.ny - 1})
    for (const int j : {0, grid.nx - 1})
      require(((grid.middle_m(i, j) - ground.origin().head<2>()) / h).cwiseAbs().maxCoeff() <
                  kMaxIndex - side,
              "a map must be within 2^23 voxels of the site's origin");
  const bool to_design = layer == MapLayer::kDesign;
  require(to_design == (design != nullptr), to_design
                                                ? "a map of heights above a design needs the design"
                                                : "a design is for a map of heights above it");
  const int ceiling = Ceiling(ceiling_m, ground).cell;
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
  std::vector<Overlap>&of_rows = reader.of_rows, &of_columns = reader.of_columns;
  of_rows.reserve(static_cast<std::size_t>(std::min(most, grid.ny)));
  of_columns.reserve(static_cast<std::size_t>(std::min(most, grid.nx)));
  reader.columns.values.reserve(static_cast<std::size_t>(
      columns_of(side * std::min(most, grid.nx), side * std::min(most, grid.ny))));
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
      HeightReader::Columns& columns = reader.columns;
      const auto read = to_design ? MapLayer::kHeight : layer;
      reader.read(first, end - first, static_cast<std::size_t>(read), ceiling, columns);
      for (std::size_t n = 0; to_design && n < columns.values.size(); ++n) {
        const int rows = columns.size.y();
        const Coord2 cell = first + Coord2(static_cast<int>(n) / rows, static_cast<int>(n) % rows);
        const Vec2 at = ground.origin().head<2>() + h * cell.cast<double>();
        columns.values[n] -= (design->height(at.x(), at.y()).value_or(HeightReader::kNoGround) -
                              ground.origin().z()) /
                             h;
      }
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
      const auto are_columns = [](const std::vector<Overlap>& all) {
        return !all.empty() && std::all_of(all.begin(), all.end(), [](const Overlap& overlap) {
          return overlap.count == 1;
        });
      };
      const bool cells_are_columns = are_columns(of_rows) && are_columns(of_columns);
      for (int j = j0; j < j1; ++j) {
        for (int i = i0; i < i1; ++i) {
          double sum = 0, whole = 0;
          const auto add = [&](double value, double share) {
            const bool some = !std::isnan(value);
            sum += some ? share * value : 0;
            whole += some ? share : 0;
          };
          if (cells_are_columns) {
            const int row = of_rows[static_cast<std::size_t>(i - i0)].first,
                      column = of_columns[static_cast<std::size_t>(j - j0)].first;
            sum = upright ? columns.at(row, column) : columns.at(column, row);
            whole = 1;
          } else if (turned) {
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
            for (int a = 0; a < in_x.count; ++a) {
              const double* value = columns.from(in_x.first + a, in_y.first);
              const double share = in_x.share(a);
              for (int b = 0; b < in_y.count; ++b) add(*value++, share * in_y.share(b));
            }
          }
          out[static_cast<std::size_t>(i) * static_cast<std::size_t>(grid.nx) +
              static_cast<std::size_t>(j)] =
              whole > 0 ? metres(sum / whole) : std::numeric_limits<T>::quiet_NaN();
        }
      }
    }
  }
}

LookResult HeightMap::map(const MapGrid& grid, MapLayer layer, std::span<double> out,
                          std::optional<double> ceiling_m, const InitialTerrain* design) noexcept {
  return LookResult::of([&] { fill(grid, layer, out, ceiling_m, design); }, out);
}
LookResult HeightMap::map(const MapGrid& grid, MapLayer layer, std::span<float> out,
                          std::optional<double> ceiling_m, const InitialTerrain* design) noexcept {
  return LookResult::of([&] { fill(grid, layer, out, ceiling_m, design); }, out);
}

}  // namespace soilvdb::inline v0
