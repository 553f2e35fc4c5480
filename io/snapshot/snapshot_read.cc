// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reading snapshots.
#include <fmt/format.h>

#include <memory>
#include <system_error>
#include <utility>

#include "core/ground/ground_writer.h"
#include "io/file/file_part.h"
#include "io/file/text.h"
#include "io/snapshot/snapshot_chain.h"
#include "io/snapshot/snapshot_format.h"
#include "io/snapshot/snapshot_samples.h"
#include "soilvdb/io/level_set_file.h"
#include "soilvdb/io/snapshot.h"

namespace soilvdb::inline v0::io {
namespace {

/// The base surface's present path: it may have moved together with the snapshot, or the snapshot
/// alone may have moved.
/// @param whole compare all bytes: OpenVDB must parse a level set only if it is the one that the
///        run checked
std::filesystem::path find_base(const std::filesystem::path& snapshot, const MetaReader& meta,
                                bool whole) {
  namespace fs = std::filesystem;
  std::error_code none;
  const fs::path relative = meta.text("soilvdb_base_file"),
                 then = meta.text("soilvdb_base_file_absolute");
  const auto beside = [&](const fs::path& place) {
    return (place.parent_path() / relative).lexically_normal();
  };
  const std::string checksum = meta.text("soilvdb_base_checksum");
  fs::path other;  // a file of that name with other content
  const fs::path here = beside(fs::absolute(snapshot).lexically_normal());
  for (const fs::path& file : {here, beside(fs::weakly_canonical(snapshot, none)), then}) {
    if (!fs::is_regular_file(file_part(file).file, none)) continue;
    if (file_fingerprint(file, whole) == checksum) return file;
    if (other.empty()) other = file;
  }
  if (!other.empty()) {
    throw InputError(snapshot, fmt::format("its base surface {} has changed since; put back the "
                                           "file the ground was dug from",
                                           other.string()));
  }
  throw InputError(
      snapshot,
      fmt::format("its base surface {} is missing{}; put it back there", then.string(),
                  here == then ? "" : fmt::format(", and there is no {}", here.string())));
}

Base open_referenced(const std::filesystem::path& snapshot, const MetaReader& meta) {
  const std::string kind = meta.text("soilvdb_base");
  if (kind == "plane") {
    return open_base(
        PlaneTerrain{meta.number("soilvdb_base_height_m"),
                     {meta.number("soilvdb_base_slope_x"), meta.number("soilvdb_base_slope_y")}});
  }
  if (kind != "raster" && kind != "level_set" && kind != kBaseGrid) {
    throw InputError(snapshot,
                     fmt::format("has a base surface of unknown kind '{}'; a newer soilvdb "
                                 "may read it",
                                 printable(kind)));
  }
  const std::filesystem::path file = find_base(snapshot, meta, kind != "raster");
  if (kind == "raster") return open_base(RasterTerrain{file});
  return open_base(LevelSetTerrain{file, meta.text("soilvdb_base_grid")});
}

/// The ground that one file holds; sets its dropped chunks.
std::unique_ptr<Ground> read_chain_ground(ChainFile& member, const Base& base,
                                          std::vector<Coord3>& dropped) {
  const MetaReader meta(member.file, *member.meta);
  const openvdb::Vec3d origin = meta.vector(kOriginKey);
  auto ground = std::make_unique<Ground>(meta.number("soilvdb_voxel_size_m"),
                                         Vec3(origin.x(), origin.y(), origin.z()), base.surface);
  dropped = restore_samples(*member.samples, *ground);
  if (fmt::format("{:016x}", ground->state_hash()) != meta.text("soilvdb_state_hash"))
    throw std::runtime_error("its ground is not what was written");
  return ground;
}

}  // namespace

Site read_snapshot(const std::filesystem::path& file, SnapshotInfo* info) {
  openvdb::initialize();
  std::vector<ChainFile> chain = open_chain(file);
  const MetaReader meta(file, *chain.front().meta);
  Base base = reading(file, file, [&] { return open_referenced(file, meta); });
  Site site;
  std::size_t chunks = 0;
  for (auto member = chain.rbegin(); member != chain.rend(); ++member) {
    reading(file, member->file, [&] {
      std::vector<Coord3> dropped;
      std::unique_ptr<Ground> ground = read_chain_ground(*member, base, dropped);
      if (!member->parent) {
        site.ground = std::move(ground);
        return;
      }
      chunks += ground->chunk_count() + dropped.size();
      GroundWriter writer(*site.ground);
      for (const Coord3& origin : dropped) writer.drop(origin);
      for (const Chunk* chunk : ground->chunks()) writer.copy_from(*ground, chunk->origin);
      if (member->file == file) member->parent->dropped = std::move(dropped);
    });
    member->samples.reset();
  }
  site.reference = std::move(base.reference);
  site.crs_wkt = meta.text(kCrsKey);
  site.bounds = base.bounds;
  site.beneath = std::move(base.beneath);
  if (info != nullptr) {
    reading(file, file, [&] {
      *info = {meta.text("soilvdb_scenario"),          meta.number("soilvdb_time_s"),
               meta.number("soilvdb_cut_m3"),          meta.number("soilvdb_captured_m3"),
               meta.number("soilvdb_displaced_m3"),    meta.number("soilvdb_dumped_m3"),
               std::move(chain.front().tracker_state), std::move(chain.front().parent)};
    });
    if (info->parent) {
      info->parent->depth = chain.size() - 1;
      info->parent->chunks = chunks;
    }
  }
  return site;
}

}  // namespace soilvdb::inline v0::io
