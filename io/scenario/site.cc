// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/site.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "io/file/file_part.h"
#include "io/file/text.h"
#include "io/scenario/workspace.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/io/level_set_file.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/lattice.h"

namespace soilvdb::inline v0::io {
namespace {

/// The absolute path without resolved links, which may later lead elsewhere. Links are resolved
/// only if a ".." follows one.
std::filesystem::path as_given(const std::filesystem::path& path) {
  std::error_code none;
  const auto [file, part] = file_part(path);
  std::filesystem::path plain = std::filesystem::absolute(file).lexically_normal();
  if (!std::filesystem::equivalent(plain, file, none)) plain = std::filesystem::canonical(file);
  return part.empty() ? plain : std::filesystem::path(plain.string() + "#" + part);
}

constexpr double kSameSize = 1e-9;  // relative: equal after a round trip through text

Base open_plane(const PlaneTerrain& plane) {
  if (!std::isfinite(plane.height_m) || !plane.slope.allFinite())
    throw std::invalid_argument("the plane's height and slope must be finite");
  const Vec2 all = Vec2::Constant(std::numeric_limits<double>::infinity());
  return {make_plane(plane.height_m, plane.slope), {plane, ""}, "", {-all, all}};
}

class HeightsInMemory : public HeightSource {
 public:
  explicit HeightsInMemory(std::shared_ptr<const RasterHeights> all) : all_(std::move(all)) {}
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int j = 0; j < ny; ++j) {
      const auto from = all_->values.begin() + (std::ptrdiff_t{y0} + j) * all_->grid.nx + x0;
      out = std::copy(from, from + nx, out);
    }
  }

 private:
  std::shared_ptr<const RasterHeights> all_;
};

template <typename T>
std::string_view bytes_of(const T* values, std::size_t count) {
  return {reinterpret_cast<const char*>(values), count * sizeof(T)};
}

Vec2 last_post(const HeightGrid& grid) {
  return grid.first + grid.spacing.cwiseProduct(Vec2(grid.nx - 1, grid.ny - 1));
}

/// @throw std::invalid_argument for heights that are no terrain
Base open_raster_base(const std::shared_ptr<const RasterHeights>& heights) {
  const auto& [grid, values] = *heights;
  const auto require = [](bool holds, const char* what) {
    if (!holds) throw std::invalid_argument(what);
  };
  require(grid.nx >= 2 && grid.ny >= 2 && static_cast<double>(values.size()) <= kMostRasterCells &&
              values.size() == std::size_t(grid.nx) * std::size_t(grid.ny),
          "heights of a terrain must have the shape (ny, nx), each 2 or more, 1e8 in all");
  require(grid.first.allFinite() && grid.spacing.allFinite() && grid.spacing.minCoeff() > 0,
          "the origin of a terrain's heights must be finite, and their cell more than 0 m");
  constexpr float kHighest_m = 1e5;
  bool any = false;
  for (const float z : values) {
    require(std::isnan(z) || std::abs(z) <= kHighest_m,
            "a terrain's heights must be within 1e5 m, or nan where there is no ground");
    any |= !std::isnan(z);
  }
  require(any, "a terrain needs a height that is not nan");
  std::uint64_t sum = crc64(bytes_of(values.data(), values.size()));
  for (const double side :
       {grid.first.x(), grid.first.y(), grid.spacing.x(), grid.spacing.y(), double(grid.nx)})
    sum = crc64(bytes_of(&side, 1), sum);
  return {make_height_field(grid, std::make_shared<HeightsInMemory>(heights)),
          {RasterTerrain{"", heights}, fmt::format("{:016x}", sum)},
          "",
          {grid.first, last_post(grid)}};
}

Base open_raster_base(const std::filesystem::path& file) {
  const RasterInput raster = open_raster(file);
  const HeightGrid& grid = raster.grid;
  return {make_height_field(grid, raster.source),
          {RasterTerrain{as_given(file)}, file_fingerprint(file)},
          raster.crs_wkt,
          {grid.first, last_post(grid)},
          std::nullopt,
          raster.warnings};
}

Base open_level_set_base(const LevelSetTerrain& terrain) {
  const std::filesystem::path& file = terrain.file;
  LevelSetInput input = read_level_set(file, terrain.grid);
  return {std::move(input.surface),
          {LevelSetTerrain{as_given(file), input.grid}, file_fingerprint(file, /*whole=*/true)},
          std::move(input.crs_wkt),
          {input.bounds.min().head<2>(), input.bounds.max().head<2>()}};
}

/// The surface of a snapshot's ground.
Base base_of(Site site, const std::filesystem::path& file) {
  BaseReference beneath = site.undug();
  return {make_ground_terrain(std::move(site.ground)),
          {LevelSetTerrain{as_given(file)}, file_fingerprint(file, /*whole=*/true)},
          std::move(site.crs_wkt),
          site.bounds,
          std::move(beneath)};
}

Base open_snapshot_base(const std::filesystem::path& file) {
  return base_of(read_snapshot(file), file);
}

void check_grid_of_snapshot(const LevelSetTerrain& terrain) {
  if (terrain.grid.empty() || terrain.grid == kSurfaceGrid) return;
  throw InputError(terrain.file, fmt::format("is a snapshot without a grid '{}'; leave 'grid' out",
                                             printable(terrain.grid)));
}

/// The middle of a base's bounds; for a plane, the world's origin.
Vec3 middle(const Base& base) {
  if (!base.bounds.sizes().allFinite()) return {0, 0, base.surface->height(0, 0).value_or(0)};
  const Vec2 at = base.bounds.center();
  return {at.x(), at.y(), base.surface->height(at.x(), at.y()).value_or(0)};
}

/// The first lip; without motions the first pour, or else the root of the first machine with
/// joints; empty without these.
std::optional<Vec3> first_place(const Scenario& scenario) {
  for (const MachineInput& machine : scenario.machines)
    if (machine.has_motion()) return machine.motion.part(0)->row(0).position;
  if (!scenario.pours.empty()) return scenario.pours.front().at_m;
  for (const MachineInput& machine : scenario.machines)
    if (machine.chain) return machine.chain->world_from_root.position;
  return std::nullopt;
}

}  // namespace

Site open_site(const Terrain& terrain, double voxel_size_m, const std::optional<Vec3>& near_m) {
  const double h = voxel_size_m;
  const auto* level_set = std::get_if<LevelSetTerrain>(&terrain);
  Base base;
  if (level_set != nullptr && is_snapshot(level_set->file)) {
    check_grid_of_snapshot(*level_set);
    Site site = read_snapshot(level_set->file);
    if (std::abs(h - site.ground->voxel_size_m()) <= kSameSize * h) return site;
    base = base_of(std::move(site), level_set->file);
  } else {
    base = open_base(terrain);
  }
  return {
      std::make_unique<Ground>(h, lattice_origin(h, near_m.value_or(middle(base))), base.surface),
      std::move(base.reference),
      std::move(base.crs_wkt),
      base.bounds,
      std::move(base.beneath),
      std::move(base.warnings)};
}

Base open_base(const Terrain& terrain) {
  if (const auto* plane = std::get_if<PlaneTerrain>(&terrain)) return open_plane(*plane);
  if (const auto* raster = std::get_if<RasterTerrain>(&terrain)) {
    return raster->heights ? open_raster_base(raster->heights) : open_raster_base(raster->file);
  }
  const auto& level_set = std::get<LevelSetTerrain>(terrain);
  if (!is_snapshot(level_set.file)) return open_level_set_base(level_set);
  check_grid_of_snapshot(level_set);
  return open_snapshot_base(level_set.file);
}

Site undug_site(const Site& site) {
  const Ground& ground = *site.ground;
  return {std::make_unique<Ground>(ground.voxel_size_m(), ground.origin(), ground.shared_terrain()),
          site.reference, site.crs_wkt, site.bounds, site.beneath};
}

Site open_site(const Scenario& scenario) {
  if (scenario.machines.empty() && scenario.pours.empty())
    throw InputError(scenario.file, "has no machines; at least one machine or pour is needed");
  Site site = open_site(scenario.terrain, scenario.voxel_size_m, first_place(scenario));
  check_workspace(scenario, site);
  return site;
}

}  // namespace soilvdb::inline v0::io
