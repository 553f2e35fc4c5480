// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Writing snapshots.
#include "soilvdb/io/snapshot.h"

#include <fmt/format.h>

#include <sstream>

#include "io/file/atomic_file.h"
#include "io/snapshot/snapshot_format.h"
#include "io/snapshot/snapshot_samples.h"
#include "soilvdb/ground_grids.h"
#include "soilvdb/io/level_set_file.h"
#include "soilvdb/version.h"

namespace soilvdb::inline v0::io {
namespace {

using openvdb::FloatGrid;
using openvdb::MetaMap;

/// Writes like io::File, with offsets for random access, to any seekable stream.
class SeekableArchive : public openvdb::io::Archive {
 public:
  void write_to(std::ostream& out, const openvdb::GridCPtrVec& grids, const MetaMap& meta) const {
    Archive::write(out, grids, /*seekable=*/true, meta);
  }
};

void put_meta(MetaMap& meta, const char* name, const std::string& value) {
  if (!value.empty()) meta.insertMeta(name, openvdb::StringMetadata(value));
}
void put_meta(MetaMap& meta, const char* name, double value) {
  meta.insertMeta(name, openvdb::DoubleMetadata(value));
}

void put_base(MetaMap& meta, const std::filesystem::path& snapshot, const BaseReference& base) {
  if (const auto* plane = std::get_if<PlaneTerrain>(&base.terrain)) {
    put_meta(meta, "soilvdb_base", "plane");
    put_meta(meta, "soilvdb_base_height_m", plane->height_m);
    put_meta(meta, "soilvdb_base_slope_x", plane->slope.x());
    put_meta(meta, "soilvdb_base_slope_y", plane->slope.y());
    return;
  }
  const auto* raster = std::get_if<RasterTerrain>(&base.terrain);
  const auto absolute = [](const std::filesystem::path& path) {
    return std::filesystem::absolute(path).lexically_normal();
  };
  const std::filesystem::path file =
      absolute(raster != nullptr ? raster->file : std::get<LevelSetTerrain>(base.terrain).file);
  const std::string grid = raster != nullptr ? "" : std::get<LevelSetTerrain>(base.terrain).grid;
  // Of another grid class, so that programs that take the first level set skip it.
  put_meta(meta, "soilvdb_base",
           raster != nullptr ? "raster"
           : grid.empty()    ? "level_set"
                             : kBaseGrid);
  put_meta(meta, "soilvdb_base_grid", grid);
  put_meta(meta, "soilvdb_base_file",
           file.lexically_proximate(absolute(snapshot).parent_path()).string());
  put_meta(meta, "soilvdb_base_file_absolute", file.string());
  put_meta(meta, "soilvdb_base_checksum", base.checksum);
}

void put_all(MetaMap& meta, const std::filesystem::path& file, const Site& site,
             const SnapshotInfo& info) {
  const Ground& ground = *site.ground;
  const Vec3& origin = ground.origin();
  meta.insertMeta("soilvdb_format", openvdb::Int32Metadata(kFormat));
  put_meta(meta, "soilvdb_version", SOILVDB_VERSION);
  put_meta(meta, "soilvdb_voxel_size_m", ground.voxel_size_m());
  meta.insertMeta(kOriginKey, openvdb::Vec3DMetadata({origin.x(), origin.y(), origin.z()}));
  put_meta(meta, kCrsKey, site.crs_wkt);
  put_meta(meta, "soilvdb_scenario", info.scenario);
  put_meta(meta, "soilvdb_time_s", info.time_s);
  put_meta(meta, "soilvdb_cut_m3", info.cut_m3);
  put_meta(meta, "soilvdb_captured_m3", info.captured_m3);
  put_meta(meta, "soilvdb_displaced_m3", info.displaced_m3);
  put_meta(meta, "soilvdb_dumped_m3", info.dumped_m3);
  put_meta(meta, "soilvdb_state_hash", fmt::format("{:016x}", ground.state_hash()));
  if (info.parent) {
    put_meta(meta, kParentKey, info.parent->name);
    put_meta(meta, kParentChecksumKey, to_text(info.parent->digest));
  }
  put_base(meta, file, site.reference);
}

}  // namespace

std::string snapshot_bytes(const std::filesystem::path& file, const Site& site,
                           const SnapshotInfo& info, const Ground* ground) {
  openvdb::initialize();
  MetaMap meta;
  put_all(meta, file, site, info);
  const std::vector<Coord3> chunks =
      info.parent ? site.ground->origins() : chunks_with_surface(*site.ground);
  const FloatGrid::Ptr surface = surface_grid(ground != nullptr ? *ground : *site.ground, chunks);
  for (auto item = meta.beginMeta(); item != meta.endMeta(); ++item) {
    surface->insertMeta(item->first, *item->second);
  }
  std::ostringstream out(std::ios::binary);
  SeekableArchive archive;
  archive.setCompression((openvdb::io::Archive::hasBloscCompression() ? openvdb::io::COMPRESS_BLOSC
                                                                      : openvdb::io::COMPRESS_ZIP) |
                         openvdb::io::COMPRESS_ACTIVE_MASK);
  archive.write_to(out, {surface}, meta);
  if (!out) throw std::runtime_error(file.string() + ": can't be written: out of memory");
  std::string bytes = std::move(out).str();
  const std::string samples =
      samples_bytes(*site.ground, info.parent ? info.parent->dropped : std::vector<Coord3>());
  bytes += samples + size_line(kSamplesWord, samples);
  if (!info.tracker_state.empty())
    bytes += info.tracker_state + size_line(kStateWord, info.tracker_state);
  put_uuid(bytes, kMark);
  return bytes += trailer(bytes);
}

void write_snapshot(const std::filesystem::path& file, const Site& site, const SnapshotInfo& info) {
  write_atomically(file, snapshot_bytes(file, site, info));
}

}  // namespace soilvdb::inline v0::io
