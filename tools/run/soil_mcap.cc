// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/soil_mcap.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "io/file/json.h"
#include "io/mcap/cdr.h"
#include "tools/run/mcap_schemas.h"

namespace soilvdb::tools {
namespace {

constexpr double kLoadsPerS = 10;
constexpr double kMostTimeS = 2147483647;  // what a stamp holds
constexpr std::size_t kMostBlocks = 32;    // of a message
constexpr std::string_view kFrame = "site", kWorld = "world";

std::uint64_t ns_of(double time_s) {
  return static_cast<std::uint64_t>(std::llround(std::clamp(time_s, 0.0, kMostTimeS) * 1e9));
}

void put_stamp(io::CdrWriter& cdr, double time_s) {
  constexpr std::uint64_t kNsPerS = 1'000'000'000;
  const std::uint64_t ns = ns_of(time_s);
  cdr.put_all(static_cast<std::int32_t>(ns / kNsPerS), static_cast<std::uint32_t>(ns % kNsPerS));
}

void put_pose(io::CdrWriter& cdr, const Vec3& position) {
  cdr.put_all(position.x(), position.y(), position.z(), 0.0, 0.0, 0.0, 1.0);
}

std::string id_of(const Coord3& block) {
  return fmt::format("block {} {} {}", block.x(), block.y(), block.z());
}

void put_deletion(io::CdrWriter& cdr, double time_s, const Coord3& block) {
  constexpr std::uint8_t kMatchingId = 0;
  put_stamp(cdr, time_s);
  cdr.put(kMatchingId);
  cdr.put(id_of(block));
}

void put_entity(io::CdrWriter& cdr, double time_s, const GroundService::Patch& patch) {
  constexpr std::uint32_t kNone = 0, kOne = 1;
  const Mesh& mesh = patch.mesh;
  put_stamp(cdr, time_s);
  cdr.put(kFrame);
  cdr.put(id_of(patch.block));
  cdr.put_all(std::int32_t{0}, std::uint32_t{0});  // it stays
  cdr.put(std::uint8_t{0});                        // in the frame as it was then
  for (int i = 0; i < 6; ++i) cdr.put(kNone);      // metadata, arrows, ..., lines
  cdr.put(kOne);                                   // triangles
  put_pose(cdr, Vec3::Zero());
  cdr.put(static_cast<std::uint32_t>(mesh.points.size()));
  for (const auto& p : mesh.points) cdr.put_all(double{p.x()}, double{p.y()}, double{p.z()});
  cdr.put_all(0.55, 0.42, 0.3, 1.0);  // colour
  cdr.put(kNone);                     // colours of points
  cdr.put(static_cast<std::uint32_t>(3 * mesh.triangles.size()));
  for (const auto& triangle : mesh.triangles) cdr.put_all(triangle[0], triangle[1], triangle[2]);
  cdr.put_all(kNone, kNone);  // texts, models
}

}  // namespace

SoilMcap::SoilMcap(const std::filesystem::path& file, const Site& site, double time_s)
    : writer_(file) {
  ground_ = writer_.add_channel("/ground", scene_update_schema(), "cdr");
  elevation_ = writer_.add_channel("/elevation", grid_map_schema(), "cdr");
  const std::uint16_t transforms = writer_.add_channel("/tf_static", transforms_schema(), "cdr");
  for (const std::string& name : site.machines) {
    // Names come from the user's files and need not be UTF-8.
    const std::string json = io::to_text(nlohmann::json(name));
    loads_.push_back({});
    loads_.back().id = writer_.add_channel("/load/" + io::parse_json(json).get<std::string>(),
                                           load_schema(), "json");
    loads_.back().name = json;
  }
  const Vec3& o = site.origin;
  writer_.add_metadata("soilvdb", {{"origin", fmt::format("{} {} {}", o.x(), o.y(), o.z())},
                                   {"voxel_size_m", fmt::format("{}", site.voxel_size_m)},
                                   {"crs_wkt", site.crs_wkt}});
  io::CdrWriter cdr;
  cdr.put(std::uint32_t{1});
  put_stamp(cdr, time_s);
  cdr.put(kWorld);
  cdr.put(kFrame);
  put_pose(cdr, o);
  writer_.write(transforms, ns_of(time_s), cdr.bytes());
}

void SoilMcap::blocks(double time_s, std::span<const GroundService::Patch> patches) {
  while (!patches.empty()) {
    const auto some = patches.first(std::min(patches.size(), kMostBlocks));
    patches = patches.subspan(some.size());
    std::vector<const GroundService::Patch*> gone, there;
    for (const GroundService::Patch& patch : some) {
      if (!patch.mesh.triangles.empty()) {
        shown_.insert(patch.block);
        there.push_back(&patch);
      } else if (shown_.erase(patch.block) > 0) {
        gone.push_back(&patch);
      }
    }
    if (gone.empty() && there.empty()) continue;
    io::CdrWriter cdr;
    cdr.put(static_cast<std::uint32_t>(gone.size()));
    for (const auto* patch : gone) put_deletion(cdr, time_s, patch->block);
    cdr.put(static_cast<std::uint32_t>(there.size()));
    for (const auto* patch : there) put_entity(cdr, time_s, *patch);
    writer_.write(ground_, ns_of(time_s), cdr.bytes());
  }
}

void SoilMcap::elevation(double time_s, const ElevationMap& map) {
  const std::size_t nx = map.size_x(), ny = map.size_y();
  const double cell_m = map.cell_m();
  const Vec2 size_m(static_cast<double>(nx) * cell_m, static_cast<double>(ny) * cell_m);
  const Vec2 middle_m = map.corner_m() + size_m / 2;
  io::CdrWriter cdr;
  put_stamp(cdr, time_s);
  cdr.put(kFrame);
  cdr.put_all(cell_m, size_m.x(), size_m.y());
  put_pose(cdr, {middle_m.x(), middle_m.y(), 0});
  for (int i = 0; i < 2; ++i) {  // layers, and those that make a cell valid
    cdr.put(std::uint32_t{1});
    cdr.put(std::string_view("elevation"));
  }
  cdr.put(std::uint32_t{1});
  // Column by column, from the highest x and y down, as grid_map has them.
  const auto columns = static_cast<std::uint32_t>(ny), rows = static_cast<std::uint32_t>(nx);
  cdr.put(std::uint32_t{2});
  cdr.put(std::string_view("column_index"));
  cdr.put_all(columns, columns * rows);
  cdr.put(std::string_view("row_index"));
  cdr.put_all(rows, rows);
  cdr.put(std::uint32_t{0});
  cdr.put(columns * rows);
  const auto heights_m = map.heights_m();
  for (std::size_t y = ny; y-- > 0;)
    for (std::size_t x = nx; x-- > 0;) cdr.put(heights_m[y * nx + x]);
  cdr.put_all(std::uint16_t{0}, std::uint16_t{0});
  writer_.write(elevation_, ns_of(time_s), cdr.bytes());
}

void SoilMcap::put(double time_s, Channel& channel, const Load& load) {
  std::string text = fmt::format(R"({{"machine":{},"time_s":{},"bucket_m3":{},"cut_m3":{})",
                                 channel.name, time_s, load.bucket_m3, load.cut_m3);
  if (load.bucket_kg) text += fmt::format(R"(,"bucket_kg":{})", *load.bucket_kg);
  writer_.write(channel.id, ns_of(time_s), text + '}');
  channel.written_s = time_s;
  channel.newest.reset();
  channel.any = true;
}

void SoilMcap::load(double time_s, std::size_t machine, const Load& load) {
  // Of a tenth that a time is at the rounded end of.
  const auto tenth = [](double at_s) { return std::floor(at_s * kLoadsPerS + 1e-6); };
  Channel& channel = loads_[machine];
  if (!channel.any || tenth(time_s) > tenth(channel.written_s)) return put(time_s, channel, load);
  channel.newest = load;
  channel.newest_s = time_s;
}

void SoilMcap::close() {
  for (Channel& channel : loads_)
    if (channel.newest) put(channel.newest_s, channel, Load(*channel.newest));
  writer_.close();
}

}  // namespace soilvdb::tools
