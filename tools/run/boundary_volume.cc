// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/boundary_volume.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <stdexcept>
#include <utility>

#include "core/lattice/chunk_math.h"
#include "core/tool/polygon.h"
#include "soilvdb/difference.h"
#include "tools/run/text.h"

namespace soilvdb::inline v0 {
namespace {

/// Cells of a boundary's inside: the most, how many there are at least, and about the most of those
/// that are finer where ground changed.
constexpr double kMostCells = 250'000, kLeastCells = 4096, kMostFine = 1'000'000;
constexpr std::size_t kMostCorners = 4096;
constexpr double kFarthestCorner_m = 1e9;

/// The part of a polygon within a box, by cutting off what is beyond each side.
std::vector<Vec2> clipped(std::vector<Vec2> polygon, const Eigen::AlignedBox2d& box) {
  for (int side = 0; side < 4; ++side) {
    const int axis = side / 2;
    const double limit = side % 2 == 0 ? box.min()[axis] : box.max()[axis];
    const double sign = side % 2 == 0 ? 1 : -1;
    if (!std::isfinite(limit)) continue;
    std::vector<Vec2> kept;
    for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
      const Vec2 &from = polygon[j], &to = polygon[i];
      const double u = sign * (from[axis] - limit), v = sign * (to[axis] - limit);
      if ((u < 0) != (v < 0)) {
        kept.push_back(from + u / (u - v) * (to - from));
        kept.back()[axis] = limit;
      }
      if (v >= 0) kept.push_back(to);
    }
    polygon = std::move(kept);
  }
  return polygon;
}

/// Places inside a polygon, each in the middle of a cell.
struct Places {
  std::vector<Vec2> xy_m;
  std::vector<double> shares;  ///< of a cell's area, in cells of the grid
};

/// Where lines of equal y cross a polygon, in order.
class Row {
 public:
  Row(const std::vector<Vec2>& polygon, double y) : y_(y) {
    for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++)
      if ((polygon[i].y() > y) != (polygon[j].y() > y))
        crossings_.push_back(crossing_x(polygon[i], polygon[j], y));
    std::sort(crossings_.begin(), crossings_.end());
  }
  /// Appends those of a line of cells whose middles are inside. @param x of the first cell's begin
  template <typename IsWanted>
  void add_cells(double x, double width, double first, double last, double share,
                 const IsWanted& is_wanted, Places& places) const {
    for (std::size_t k = 0; k + 1 < crossings_.size(); k += 2) {
      const double begin = std::ceil((crossings_[k] - x) / width - 0.5);
      for (double n = std::max(first, begin); n < last && x + (n + 0.5) * width < crossings_[k + 1];
           ++n) {
        if (!is_wanted(n)) continue;
        places.xy_m.emplace_back(x + (n + 0.5) * width, y_);
        places.shares.push_back(share);
      }
    }
  }

 private:
  double y_;
  std::vector<double> crossings_;
};

/// Cells of a grid inside a polygon, row by row, and finer ones instead where ground changed, as it
/// may change from voxel to voxel. @param area_m2 of the polygon @param changed null: nowhere
Places places_in(const std::vector<Vec2>& polygon, double area_m2, double voxel_m,
                 const Ground* changed) {
  Eigen::AlignedBox2d box;
  for (const Vec2& corner : polygon) box.extend(corner);
  const double fine_m = std::min(voxel_m, std::sqrt(area_m2 / kLeastCells));
  const double cell_m = std::max(fine_m, std::sqrt(area_m2 / kMostCells));
  // A narrow boundary has more rows than it needs.
  const double rows = std::clamp(std::ceil(box.sizes().y() / cell_m), 1.0, kMostCells);
  const double high_m = box.sizes().y() / rows, wide_m = cell_m * cell_m / high_m;
  const Vec2& low = box.min();
  std::set<std::pair<double, double>> finer;  // rows and columns of cells with ground that changed
  if (changed != nullptr && cell_m > voxel_m) {
    const Eigen::Array2d cells(wide_m, high_m);
    for (const Coord3& origin : changed->origins()) {
      const Vec2 begin =
          changed->world_from_index(origin.cast<double>()).head<2>().array() - voxel_m / 2;
      const Vec2 end = begin.array() + kChunkSide * voxel_m;
      if (!box.intersects(Eigen::AlignedBox2d(begin, end))) continue;
      const Eigen::Array2d from = ((begin - low).array() / cells).floor();
      const Eigen::Array2d to = ((end - low).array() / cells).floor();
      for (double row = from.y(); row <= to.y(); ++row)
        for (double n = from.x(); n <= to.x(); ++n) finer.emplace(row, n);
    }
  }
  Places places;
  for (double row = 0; row < rows; ++row)
    Row(polygon, low.y() + (row + 0.5) * high_m)
        .add_cells(
            low.x(), wide_m, 0, std::numeric_limits<double>::infinity(), 1,
            [&](double n) {
              return finer.empty() || !finer.contains({row, n});
            },
            places);
  const double part_m =
      std::max(voxel_m, std::sqrt(static_cast<double>(finer.size()) * wide_m * high_m / kMostFine));
  const double columns = std::ceil(wide_m / part_m), lines = std::ceil(high_m / part_m);
  for (auto at = finer.begin(); at != finer.end();) {
    const double row = at->first;
    const auto end = finer.upper_bound({row, std::numeric_limits<double>::infinity()});
    for (double line = 0; line < lines; ++line) {
      const Row of_parts(polygon, low.y() + (row + (line + 0.5) / lines) * high_m);
      for (auto cell = at; cell != end; ++cell)
        of_parts.add_cells(
            low.x(), wide_m / columns, columns * cell->second, columns * (cell->second + 1),
            1 / (columns * lines), [](double) { return true; }, places);
    }
    at = end;
  }
  return places;
}

}  // namespace

Heights heights_of(const InitialTerrain& surface) {
  return [&surface](std::span<const Vec2> xy_m, std::span<double> heights_m) {
    for (std::size_t i = 0; i < xy_m.size(); ++i)
      heights_m[i] = surface.height(xy_m[i].x(), xy_m[i].y())
                         .value_or(std::numeric_limits<double>::quiet_NaN());
  };
}

BoundaryVolume volume_inside(const io::Site& site, const Ground& before,
                             const std::vector<Vec2>& boundary, const Heights& now,
                             const InitialTerrain* design) {
  if (boundary.size() < 3 || boundary.size() > kMostCorners)
    throw std::invalid_argument(fmt::format("a boundary must have 3 to {} corners", kMostCorners));
  for (const Vec2& corner : boundary)
    if (!(corner.cwiseAbs().maxCoeff() <= kFarthestCorner_m))
      throw std::invalid_argument(
          fmt::format("a boundary's corners must be within {:g} m of 0, 0", kFarthestCorner_m));
  const Difference change = difference(before, *site.ground, boundary);
  const std::vector<Vec2> on_site = clipped(boundary, site.bounds);
  const double on_site_m2 = on_site.empty() ? 0 : area_of(on_site);
  Places places;
  if (on_site_m2 > 0)
    places = places_in(on_site, on_site_m2, site.ground->voxel_size_m(),
                       design != nullptr ? site.ground.get() : nullptr);
  const std::size_t count = places.xy_m.size();
  std::vector<double> ground(count);
  heights_of(site.ground->initial_terrain())(places.xy_m, ground);
  double all = 0, voids = 0;  // in cells
  for (std::size_t i = 0; i < count; ++i) {
    all += places.shares[i];
    if (std::isnan(ground[i])) voids += places.shares[i];
  }
  if (change.area_m2 > 0 && voids == all)
    throw std::invalid_argument("there is no ground inside the boundary: the terrain goes " +
                                tools::extent_text(site.bounds));
  const double cell_m2 = all > 0 ? on_site_m2 / all : on_site_m2;
  const double area_m2 = on_site_m2 - voids * cell_m2;
  BoundaryVolume volume{.cut_m3 = change.cut_m3,
                        .fill_m3 = change.fill_m3,
                        .net_m3 = change.net_m3,
                        .error_m3 = change.error_m3,
                        .area_m2 = area_m2,
                        .off_site_m2 = change.area_m2 - area_m2};
  if (design == nullptr) return volume;
  std::vector<double> heights(count), wanted(count);
  now(places.xy_m, heights);
  heights_of (*design)(places.xy_m, wanted);
  double cut_m = 0, fill_m = 0, compared = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double above_m = heights[i] - wanted[i];
    if (std::isnan(above_m)) continue;
    compared += places.shares[i];
    (above_m > 0 ? cut_m : fill_m) += places.shares[i] * std::abs(above_m);
  }
  volume.to_design = {compared * cell_m2, cut_m * cell_m2, fill_m * cell_m2};
  return volume;
}

}  // namespace soilvdb::inline v0
