// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb export: a snapshot as mesh, raster, LandXML surface, picture, closed level set or
// occupancy.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>

#include "io/file/text.h"
#include "io/terrain/crs.h"
#include "io/terrain/tin.h"
#include "soilvdb/io/mesh_file.h"
#include "soilvdb/io/picture.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/mesher.h"
#include "tools/app/clip.h"
#include "tools/app/commands.h"
#include "tools/run/outputs.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;
using Box2 = Eigen::AlignedBox2d;

constexpr std::array kMeshes = {".ply", ".obj", ".stl", ".glb"};

bool is_mesh(const std::string& suffix) {
  return std::find(kMeshes.begin(), kMeshes.end(), suffix) != kMeshes.end();
}

void export_mesh(const fs::path& to, const io::Site& site, const std::optional<Box2>& region) {
  const Mesh mesh = region ? mesh_region(*site.ground, *region) : mesh_all(*site.ground);
  if (mesh.triangles.empty()) throw std::invalid_argument("there is no surface of dug ground");
  io::write_mesh(to, mesh, site.ground->origin(), site.crs_wkt);
  fmt::print("{}: {} vertices, {} triangles\n", to.string(), mesh.points.size(),
             mesh.triangles.size());
}

void export_raster(const fs::path& to, const io::Site& site, const std::optional<Box2>& region) {
  const Box2 box = region ? *region : io::footprint(*site.ground, false);
  const double cell_m = affordable_cell_m(box, site.ground->voxel_size_m());
  write_surface_raster(to, *site.ground, box, cell_m, site.crs_wkt);
  fmt::print("{}: bands surface and change, cells of {} m\n", to.string(), length_text(cell_m));
}

void export_landxml(const fs::path& to, const io::Site& site, const std::string& name,
                    const std::optional<Box2>& region) {
  constexpr double kMostPosts = 1e6;  // which other programs open; 100 MB
  const Ground& ground = *site.ground;
  Box2 box = region ? *region : io::footprint(ground, false);
  const double cell_m = affordable_cell_m(box, ground.voxel_size_m(), kMostPosts);
  // A border of undug ground closes the cut.
  if (!region) box = {box.min().array() - cell_m, box.max().array() + cell_m};
  const io::SurfaceRaster raster = io::rasterise(ground, box, cell_m);
  io::write_landxml(to, raster.grid, raster.surface, name, site.crs_wkt);
  fmt::print("{}: surface of posts {} m apart\n", to.string(), length_text(cell_m));
}

void export_picture(const fs::path& to, const io::Site& site, const io::SnapshotInfo& info,
                    const std::optional<Box2>& region, bool perspective) {
  const Box2 box = region ? *region : io::region_of_interest(*site.ground);
  const io::CutAndFill net = io::cut_and_fill(*site.ground);
  std::string detail = fmt::format("cut {} m³", number(net.cut_m3));
  if (net.fill_m3 > 0) detail += fmt::format(", fill {} m³", number(net.fill_m3));
  detail += fmt::format(" by {} s, {} m voxels", time_text(info.time_s),
                        length_text(site.ground->voxel_size_m()));
  if (!site.crs_wkt.empty()) detail += ", " + io::crs_label(site.crs_wkt);
  const io::Caption caption{info.scenario, detail};
  (perspective ? io::write_view : io::write_plan)(to, *site.ground, box, caption);
  fmt::print("{}: {}\n", to.string(), perspective ? "perspective view" : "plan");
}

void export_vdb(const fs::path& to, const io::Site& site, const std::optional<Box2>& region,
                bool occupancy) {
  const Ground& ground = *site.ground;
  Box2 plan = region ? *region : io::region_of_interest(ground);
  if (!site.bounds.isEmpty()) plan = plan.intersection(site.bounds);
  if (plan.isEmpty()) throw std::invalid_argument("the terrain has no heights");
  const Eigen::AlignedBox3d box = ground_box(ground, plan);
  const std::uint64_t voxels = (occupancy ? write_occupancy : write_level_set)(to, site, box);
  fmt::print("{}: {} of {} m x {} m x {} m, {} voxels\n", to.string(),
             occupancy ? "occupancy" : "closed level set", number(box.sizes().x()),
             number(box.sizes().y()), number(box.sizes().z()), voxels);
}

}  // namespace

void export_file(const ExportOptions& options) {
  const std::string suffix = io::suffix_of(options.to);
  if (!is_mesh(suffix) && suffix != ".tif" && suffix != ".png" && suffix != ".vdb" &&
      suffix != ".xml")
    throw io::InputError(
        options.to,
        fmt::format("the suffix '{}' is not one of .ply .obj .stl .glb .tif .xml .png .vdb",
                    options.to.extension().string()));
  if (options.view && suffix != ".png")
    throw io::InputError(options.to, "--view is for pictures; leave it out, or give a .png");
  if (options.occupancy && suffix != ".vdb")
    throw io::InputError(options.to, "--occupancy is for grids; leave it out, or give a .vdb");
  std::optional<Box2> region;
  if (options.region) region = parse_region(*options.region);
  io::check_readable(options.file);
  check_output(options.to, options.file);
  if (!io::is_snapshot(options.file))
    throw io::InputError(options.file,
                         "is not a snapshot of soilvdb; give a soil_*.vdb that "
                         "soilvdb run wrote");
  io::SnapshotInfo info;
  const io::Site site = io::read_snapshot(options.file, &info);
  const Box2 resident = io::footprint(*site.ground, false);
  if (resident.isEmpty())
    throw io::InputError(options.file,
                         "holds no ground: no bucket had met any soil yet; give a "
                         "later snapshot");
  if (region && region->intersection(resident).isEmpty())
    throw io::InputError(
        fmt::format("--region {}: misses the dug ground, which is at "
                    "{:.3f},{:.3f},{:.3f},{:.3f}",
                    *options.region, resident.min().x(), resident.min().y(), resident.max().x(),
                    resident.max().y()));
  try {
    if (is_mesh(suffix)) export_mesh(options.to, site, region);
    if (suffix == ".tif") export_raster(options.to, site, region);
    if (suffix == ".xml") export_landxml(options.to, site, info.scenario, region);
    if (suffix == ".png")
      export_picture(options.to, site, info, region, options.view == "perspective");
    if (suffix == ".vdb") export_vdb(options.to, site, region, options.occupancy);
  } catch (const std::invalid_argument& e) {
    const std::string where =
        options.region ? "--region " + *options.region : options.file.string();
    throw io::InputError(where + ": " + e.what());
  }
}

}  // namespace soilvdb::tools
