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

namespace soilvdb::inline v0 {
namespace {

/// Sampling of a boundary's inside: the most cells, and the least number along a side.
constexpr double kMostCells = 250'000, kLeastAcross = 64;

/// Centres of a grid of cells inside a boundary.
std::vector<Vec2> places_in(const std::vector<Vec2>& boundary, double voxel_m) {
  Eigen::AlignedBox2d box;
  for (const Vec2& corner : boundary) box.extend(corner);
  const Vec2 size = box.sizes();
  const double fine_m = std::min(voxel_m, size.maxCoeff() / kLeastAcross);
  const double cell_m = std::max(fine_m, std::sqrt(box.volume() / kMostCells));
  const Eigen::Array2d cells = (size.array() / cell_m).ceil().max(1).min(kMostCells);
  std::vector<Vec2> places;
  for (double j = 0.5; j < cells.y(); ++j)
    for (double i = 0.5; i < cells.x(); ++i)
      if (const Vec2 at = box.min().array() + size.array() * Eigen::Array2d(i, j) / cells;
          inside(boundary, at))
        places.push_back(at);
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
  const Difference change = difference(before, *site.ground, boundary);
  const std::vector<Vec2> places = places_in(boundary, site.ground->voxel_size_m());
  std::vector<double> ground(places.size());
  heights_of(site.ground->initial_terrain())(places, ground);
  const auto off_site =
      std::count_if(ground.begin(), ground.end(), [](double z) { return std::isnan(z); });
  const auto all = static_cast<std::ptrdiff_t>(places.size());
  if (all > 0 && off_site == all)
    throw std::invalid_argument(fmt::format(
        "there is no ground inside the boundary: the terrain goes from {:.0f}, {:.0f} to {:.0f}, "
        "{:.0f}",
        site.bounds.min().x(), site.bounds.min().y(), site.bounds.max().x(),
        site.bounds.max().y()));
  const double cell_m2 = change.area_m2 / static_cast<double>(std::max<std::ptrdiff_t>(all, 1));
  const double off_site_m2 = static_cast<double>(off_site) * cell_m2;
  BoundaryVolume volume{.cut_m3 = change.cut_m3,
                        .fill_m3 = change.fill_m3,
                        .net_m3 = change.net_m3,
                        .error_m3 = change.error_m3,
                        .area_m2 = change.area_m2 - off_site_m2,
                        .off_site_m2 = off_site_m2};
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
