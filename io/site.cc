// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/site.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "io/checksum.h"
#include "io/level_set_file.h"
#include "io/raster.h"
#include "io/reach.h"
#include "io/snapshot.h"

namespace soilvdb::io {
namespace {

constexpr double kOriginStep = 100;  // m
constexpr double kSameSize = 1e-9;   // relative: the same number, through text

Base open_plane(const PlaneTerrain& plane) {
  const Vec2 all = Vec2::Constant(std::numeric_limits<double>::infinity());
  return {make_plane(plane.height_m, plane.slope), {plane, ""}, "", {-all, all}};
}

Base open_raster_base(const std::filesystem::path& file) {
  const RasterInput raster = open_raster(file);
  const HeightGrid& grid = raster.grid;
  const Vec2 last = grid.first + grid.spacing.cwiseProduct(Vec2(grid.nx - 1, grid.ny - 1));
  return {make_height_field(grid, raster.source),
          {RasterTerrain{std::filesystem::canonical(file)}, file_fingerprint(file)},
          raster.crs_wkt,
          {grid.first, last}};
}

Base open_level_set_base(const std::filesystem::path& file) {
  LevelSetInput input = read_level_set(file);
  return {
      std::move(input.surface),
      {LevelSetTerrain{std::filesystem::canonical(file)}, file_fingerprint(file, /*whole=*/true)},
      std::move(input.crs_wkt),
      {input.bounds.min().head<2>(), input.bounds.max().head<2>()}};
}

/// Where the first machine's lip starts, to 100 m.
Vec3 origin_of(const Scenario& scenario) {
  const Vec3 lip = scenario.machines.front().motion.part(0)->row(0).position;
  // Adding 0 turns -0 into 0.
  return (lip.array() / kOriginStep).round() * kOriginStep + 0.0;
}

Site open_terrain(const Scenario& scenario) {
  const auto* level_set = std::get_if<LevelSetTerrain>(&scenario.terrain);
  if (level_set != nullptr && is_snapshot(level_set->file)) {
    Site site = read_snapshot(level_set->file);
    const double h = site.soil->voxel_size_m();
    if (std::abs(h - scenario.voxel_size_m) > kSameSize * h) {
      throw InputError(scenario.file,
                       fmt::format("voxel_size is {:g}, but its terrain, the snapshot {}, has "
                                   "voxels of {} m; voxel_size: {} would do",
                                   scenario.voxel_size_m, level_set->file.string(), h, h));
    }
    return site;
  }
  Base base = open_base(scenario.terrain);
  return {std::make_unique<Soil>(scenario.voxel_size_m, origin_of(scenario), base.surface),
          std::move(base.reference), std::move(base.crs_wkt), base.bounds};
}

}  // namespace

Base open_base(const Terrain& terrain) {
  if (const auto* plane = std::get_if<PlaneTerrain>(&terrain)) return open_plane(*plane);
  if (const auto* raster = std::get_if<RasterTerrain>(&terrain)) {
    return open_raster_base(raster->file);
  }
  return open_level_set_base(std::get<LevelSetTerrain>(terrain).file);
}

Site untouched(const Site& site) {
  const Soil& soil = *site.soil;
  return {std::make_unique<Soil>(soil.voxel_size_m(), soil.origin(), soil.shared_base()),
          site.reference, site.crs_wkt, site.bounds};
}

Site open_site(const Scenario& scenario) {
  if (scenario.machines.empty()) throw InputError(scenario.file, "has no machines; one would do");
  Site site = open_terrain(scenario);
  check_reach(scenario, site);
  return site;
}

}  // namespace soilvdb::io
