// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb diff: cut and fill between two snapshots of a site.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "io/draw/change_plan.h"
#include "io/file/json.h"
#include "io/file/text.h"
#include "soilvdb/difference.h"
#include "soilvdb/io/picture.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "tools/app/commands.h"
#include "tools/run/outputs.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

struct Snapshot {
  fs::path file;
  io::SnapshotInfo info;
  io::Site site;
};

Snapshot snapshot_of(const fs::path& file) {
  io::check_readable(file);
  if (!io::is_snapshot(file))
    throw io::InputError(file,
                         "is not a snapshot of soilvdb; give a soil_*.vdb that soilvdb run "
                         "wrote");
  Snapshot snapshot;
  snapshot.file = file;
  snapshot.site = io::read_snapshot(file, &snapshot.info);
  return snapshot;
}

bool same_base(const io::BaseReference& a, const io::BaseReference& b) {
  const auto* plane_a = std::get_if<io::PlaneTerrain>(&a.terrain);
  const auto* plane_b = std::get_if<io::PlaneTerrain>(&b.terrain);
  if (plane_a && plane_b)
    return plane_a->height_m == plane_b->height_m && plane_a->slope == plane_b->slope;
  // Two paths may name the same file.
  const auto* set_a = std::get_if<io::LevelSetTerrain>(&a.terrain);
  const auto* set_b = std::get_if<io::LevelSetTerrain>(&b.terrain);
  if (set_a && set_b && set_a->grid != set_b->grid) return false;
  return a.terrain.index() == b.terrain.index() && a.checksum == b.checksum;
}

void check_same_site(const Snapshot& a, const Snapshot& b) {
  const auto refuse = [&](const std::string& what) -> io::InputError {
    return io::InputError(b.file,
                          fmt::format("is not of the same site as {}: {}", a.file.string(), what));
  };
  const io::BaseReference &of_a = a.site.undug(), &of_b = b.site.undug();
  if (!same_base(of_a, of_b))
    throw refuse(fmt::format("its ground before digging is {}, not {}", terrain_text(of_b.terrain),
                             terrain_text(of_a.terrain)));
}

/// A box to draw: the changes or, without changes, all ground that was ever dug.
Eigen::AlignedBox2d box_to_show(const Difference& change, const io::Site& a, const io::Site& b) {
  if (!change.box.isEmpty()) return change.box;
  const Eigen::AlignedBox2d dug =
      io::footprint(*a.ground, false).merged(io::footprint(*b.ground, false));
  if (!dug.isEmpty()) return dug;
  constexpr double kAround_m = 10;
  const Vec2 middle = a.bounds.center(), around = Vec2::Constant(kAround_m);
  const Vec2 centre = middle.allFinite() ? middle : Vec2(a.ground->origin().head<2>());
  return {centre - around, centre + around};
}

void write_raster(const fs::path& to, const Snapshot& a, const Snapshot& b,
                  const Eigen::AlignedBox2d& box) {
  const double cell_m = affordable_cell_m(
      box, std::max(a.site.ground->voxel_size_m(), b.site.ground->voxel_size_m()));
  const io::SurfaceRaster raster = io::rasterise(*b.site.ground, box, cell_m);
  const std::vector<float> change = io::rasterise_change(
      *a.site.ground, *b.site.ground, same_base(a.site.reference, b.site.reference), raster);
  io::write_geotiff(to, raster.grid, {{"change", change}, {"surface", raster.surface}},
                    b.site.crs_wkt);
}

}  // namespace

void diff(const DiffOptions& options) {
  const std::string suffix = options.to ? io::suffix_of(*options.to) : "";
  if (options.to && suffix != ".tif" && suffix != ".png")
    throw io::InputError(*options.to, fmt::format("the suffix '{}' is neither .tif nor .png",
                                                  options.to->extension().string()));
  for (const fs::path& input : {options.before, options.after}) io::check_readable(input);
  if (options.to)
    for (const fs::path& input : {options.before, options.after}) check_output(*options.to, input);
  const Snapshot a = snapshot_of(options.before), b = snapshot_of(options.after);
  check_same_site(a, b);

  const Difference change =
      difference(*a.site.ground, *b.site.ground, same_base(a.site.reference, b.site.reference));
  if (options.to) {
    const Eigen::AlignedBox2d box = box_to_show(change, a.site, b.site);
    if (suffix == ".tif") write_raster(*options.to, a, b, box);
    if (suffix == ".png")
      io::write_change_plan(
          *options.to, *a.site.ground, *b.site.ground, box, change.fill_m3 > change.error_m3,
          {fmt::format("{}: {} s to {} s", b.info.scenario, time_text(a.info.time_s),
                       time_text(b.info.time_s)),
           fmt::format("cut {} m³, fill {} m³", number(change.cut_m3), number(change.fill_m3))});
  }
  if (options.json) {
    const nlohmann::ordered_json json = {{"cut_m3", change.cut_m3},     {"fill_m3", change.fill_m3},
                                         {"net_m3", change.net_m3},     {"area_m2", change.area_m2},
                                         {"error_m3", change.error_m3}, {"exact", change.exact}};
    fmt::print("{}\n", io::to_text(json, 2));
    return;
  }
  fmt::print("before  {} at {} s\n", a.file.string(), time_text(a.info.time_s));
  fmt::print("after   {} at {} s\n", b.file.string(), time_text(b.info.time_s));
  fmt::print("cut     {} m³\nfill    {} m³\nnet     {} m³\narea    {} m²\n", number(change.cut_m3),
             number(change.fill_m3), number(change.net_m3), number(change.area_m2));
  fmt::print(
      "error   {} m³ of cut and of fill, {}\n", number(change.error_m3),
      change.exact
          ? "compared sample by sample"
          : "compared in boxes of the larger voxels, for their voxels or grounds are not the same");
  if (options.to) fmt::print("file    {}\n", options.to->string());
}

}  // namespace soilvdb::tools
