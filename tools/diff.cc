// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb diff: cut and fill between two snapshots of a site, exact to the sample.
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "io/change_plan.h"
#include "io/raster.h"
#include "io/snapshot.h"
#include "io/text.h"
#include "tools/commands.h"
#include "tools/outputs.h"
#include "tools/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

struct Snapshot {
  fs::path file;
  io::SnapshotInfo info;
  io::Site site;
};

Snapshot open(const fs::path& file) {
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
  // The same file may be found by two names.
  return a.terrain.index() == b.terrain.index() && a.checksum == b.checksum;
}

void check_same_site(const Snapshot& a, const Snapshot& b) {
  const auto refuse = [&](const std::string& what) -> io::InputError {
    return io::InputError(b.file,
                          fmt::format("is not of the same site as {}: {}", a.file.string(), what));
  };
  const auto text = [](const Vec3& v) { return fmt::format("{} {} {}", v.x(), v.y(), v.z()); };
  const Soil &soil_a = *a.site.soil, &soil_b = *b.site.soil;
  if (soil_a.voxel_size_m() != soil_b.voxel_size_m())
    throw refuse(
        fmt::format("its voxels are {} m, not {} m", soil_b.voxel_size_m(), soil_a.voxel_size_m()));
  if (soil_a.origin() != soil_b.origin())
    throw refuse(
        fmt::format("its origin is {}, not {}", text(soil_b.origin()), text(soil_a.origin())));
  if (!same_base(a.site.reference, b.site.reference))
    throw refuse(fmt::format("its ground before digging is {}, not {}",
                             terrain_text(b.site.reference.terrain),
                             terrain_text(a.site.reference.terrain)));
}

/// Origins of the chunks that are resident in either, sorted.
std::vector<Coord3> chunks_of_both(const Soil& a, const Soil& b) {
  std::vector<Coord3> origins;
  for (const Soil* soil : {&a, &b})
    for (const Chunk* chunk : soil->chunks()) origins.push_back(chunk->origin);
  const auto less = [](const Coord3& p, const Coord3& q) {
    return std::lexicographical_compare(p.data(), p.data() + 3, q.data(), q.data() + 3);
  };
  std::sort(origins.begin(), origins.end(), less);
  origins.erase(std::unique(origins.begin(), origins.end()), origins.end());
  return origins;
}

/// What changed, in samples; columns of voxels for the area.
struct Change {
  std::int64_t cut = 0, fill = 0, columns = 0;
  Eigen::AlignedBox2d box;  ///< of the columns that changed, world
};

Change compare(const Soil& a, const Soil& b) {
  const std::vector<Coord3> origins = chunks_of_both(a, b);
  struct Part {
    std::int64_t cut = 0, fill = 0;
    std::uint64_t columns = 0;  ///< bit x * 8 + y
  };
  std::vector<Part> parts(origins.size());
  tbb::parallel_for(std::size_t{0}, origins.size(), [&](std::size_t i) {
    SampleWords before, after;
    a.read_samples(origins[i], before);
    b.read_samples(origins[i], after);
    for (std::size_t n = 0; n < before.size(); ++n) {
      parts[i].cut += std::popcount(before[n] & ~after[n]);
      parts[i].fill += std::popcount(after[n] & ~before[n]);
      if (before[n] != after[n]) parts[i].columns |= std::uint64_t{1} << (n >> 3);
    }
  });
  Change change;
  std::map<std::pair<int, int>, std::uint64_t> columns;  // of all chunks above each other
  for (std::size_t i = 0; i < origins.size(); ++i) {
    change.cut += parts[i].cut;
    change.fill += parts[i].fill;
    if (parts[i].columns) columns[{origins[i].x(), origins[i].y()}] |= parts[i].columns;
  }
  for (const auto& [at, bits] : columns) {
    change.columns += std::popcount(bits);
    for (int bit = 0; bit < 64; ++bit) {
      if (!(bits >> bit & 1)) continue;
      const Vec3 low(at.first + (bit >> 3) - 0.5, at.second + (bit & 7) - 0.5, 0);
      change.box.extend(a.world_from_index(low).head<2>());
      change.box.extend(a.world_from_index(low + Vec3::Ones()).head<2>());
    }
  }
  return change;
}

/// A box that can be drawn: what changed, or where nothing did, all ground that was ever dug.
Eigen::AlignedBox2d box_to_show(const Change& change, const Soil& a, const Soil& b) {
  if (!change.box.isEmpty()) return change.box;
  const Eigen::AlignedBox2d dug = resident_box(a).merged(resident_box(b));
  constexpr double kAround_m = 10;
  const Vec2 centre = a.origin().head<2>(), around = Vec2::Constant(kAround_m);
  return dug.isEmpty() ? Eigen::AlignedBox2d(centre - around, centre + around) : dug;
}

void write_raster(const fs::path& to, const Snapshot& a, const Snapshot& b,
                  const Eigen::AlignedBox2d& box) {
  const double cell_m = affordable_cell_m(box, a.site.soil->voxel_size_m());
  const io::SurfaceRaster before = io::rasterise(*a.site.soil, box, cell_m);
  const io::SurfaceRaster after = io::rasterise(*b.site.soil, box, cell_m);
  std::vector<float> change(after.surface.size());
  for (std::size_t i = 0; i < change.size(); ++i) change[i] = after.change[i] - before.change[i];
  io::write_geotiff(to, after.grid, {{"change", change}, {"surface", after.surface}},
                    b.site.crs_wkt);
}

}  // namespace

void diff(const DiffOptions& options) {
  const std::string suffix = options.to ? suffix_of(*options.to) : "";
  if (options.to && suffix != "tif" && suffix != "png")
    throw io::InputError(*options.to, fmt::format("the suffix '{}' is neither .tif nor .png",
                                                  options.to->extension().string()));
  for (const fs::path& input : {options.before, options.after}) io::check_readable(input);
  if (options.to)
    for (const fs::path& input : {options.before, options.after}) check_output(*options.to, input);
  const Snapshot a = open(options.before), b = open(options.after);
  check_same_site(a, b);

  const Change change = compare(*a.site.soil, *b.site.soil);
  const double h = a.site.soil->voxel_size_m(), sample_m3 = a.site.soil->sample_m3();
  const double cut_m3 = static_cast<double>(change.cut) * sample_m3;
  const double fill_m3 = static_cast<double>(change.fill) * sample_m3;
  const double net_m3 = static_cast<double>(change.fill - change.cut) * sample_m3;
  const double area_m2 = static_cast<double>(change.columns) * h * h;

  if (options.to) {
    const Eigen::AlignedBox2d box = box_to_show(change, *a.site.soil, *b.site.soil);
    if (suffix == "tif") write_raster(*options.to, a, b, box);
    if (suffix == "png")
      io::write_change_plan(
          *options.to, *a.site.soil, *b.site.soil, box,
          {fmt::format("{}: {} s to {} s", b.info.scenario, time_text(a.info.time_s),
                       time_text(b.info.time_s)),
           fmt::format("cut {} m³, fill {} m³", number(cut_m3), number(fill_m3))});
  }
  if (options.json) {
    const nlohmann::ordered_json json = {
        {"cut_m3", cut_m3}, {"fill_m3", fill_m3}, {"net_m3", net_m3}, {"area_m2", area_m2}};
    fmt::print("{}\n", json.dump(2));
    return;
  }
  fmt::print("before  {} at {} s\n", a.file.string(), time_text(a.info.time_s));
  fmt::print("after   {} at {} s\n", b.file.string(), time_text(b.info.time_s));
  fmt::print("cut     {} m³\nfill    {} m³\nnet     {} m³\narea    {} m²\n", number(cut_m3),
             number(fill_m3), number(net_m3), number(area_m2));
  if (options.to) fmt::print("file    {}\n", options.to->string());
}

}  // namespace soilvdb::tools
