// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/boundary_volume.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "core/tool/polygon.h"
#include "soilvdb/difference.h"
#include "tools/run/text.h"

namespace soilvdb::inline v0 {
namespace {

/// Cells of a boundary's inside: the most, and how many there are at least.
constexpr double kMostCells = 250'000, kLeastCells = 4096;
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

/// Centres of the cells of a grid inside a polygon, row by row. @param area_m2 of the polygon
std::vector<Vec2> places_in(const std::vector<Vec2>& polygon, double area_m2, double voxel_m) {
  Eigen::AlignedBox2d box;
  for (const Vec2& corner : polygon) box.extend(corner);
  const double fine_m = std::min(voxel_m, std::sqrt(area_m2 / kLeastCells));
  const double cell_m = std::max(fine_m, std::sqrt(area_m2 / kMostCells));
  // A narrow boundary has more rows than it needs.
  const double rows = std::clamp(std::ceil(box.sizes().y() / cell_m), 1.0, kMostCells);
  const double high_m = box.sizes().y() / rows, wide_m = cell_m * cell_m / high_m;
  std::vector<Vec2> places;
  std::vector<double> crossings;
  for (double row = 0.5; row < rows; ++row) {
    const double y = box.min().y() + row * high_m;
    crossings.clear();
    for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++)
      if ((polygon[i].y() > y) != (polygon[j].y() > y))
        crossings.push_back(crossing_x(polygon[i], polygon[j], y));
    std::sort(crossings.begin(), crossings.end());
    for (std::size_t k = 0; k + 1 < crossings.size(); k += 2) {
      const double first = std::ceil((crossings[k] - box.min().x()) / wide_m - 0.5);
      for (double n = first; box.min().x() + (n + 0.5) * wide_m < crossings[k + 1]; ++n)
        places.emplace_back(box.min().x() + (n + 0.5) * wide_m, y);
    }
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
  const std::vector<Vec2> places = on_site_m2 > 0
                                       ? places_in(on_site, on_site_m2, site.ground->voxel_size_m())
                                       : std::vector<Vec2>();
  std::vector<double> ground(places.size());
  heights_of(site.ground->initial_terrain())(places, ground);
  const auto voids =
      std::count_if(ground.begin(), ground.end(), [](double z) { return std::isnan(z); });
  const auto all = static_cast<std::ptrdiff_t>(places.size());
  if (change.area_m2 > 0 && voids == all)
    throw std::invalid_argument("there is no ground inside the boundary: the terrain goes " +
                                tools::extent_text(site.bounds));
  const double cell_m2 = on_site_m2 / static_cast<double>(std::max<std::ptrdiff_t>(all, 1));
  const double area_m2 = on_site_m2 - static_cast<double>(voids) * cell_m2;
  BoundaryVolume volume{.cut_m3 = change.cut_m3,
                        .fill_m3 = change.fill_m3,
                        .net_m3 = change.net_m3,
                        .error_m3 = change.error_m3,
                        .area_m2 = area_m2,
                        .off_site_m2 = change.area_m2 - area_m2};
  if (design == nullptr) return volume;
  std::vector<double> heights(places.size()), wanted(places.size());
  now(places, heights);
  heights_of (*design)(places, wanted);
  double cut_m = 0, fill_m = 0, compared = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double above_m = heights[i] - wanted[i];
    if (std::isnan(above_m)) continue;
    ++compared;
    (above_m > 0 ? cut_m : fill_m) += std::abs(above_m);
  }
  volume.to_design = {compared * cell_m2, cut_m * cell_m2, fill_m * cell_m2};
  return volume;
}

}  // namespace soilvdb::inline v0
