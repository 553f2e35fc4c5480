// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/snapshot.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "core/soil_grids.h"
#include "io/atomic_file.h"
#include "io/checksum.h"
#include "io/level_set_file.h"
#include "io/text.h"

namespace soilvdb::io {
namespace {

using openvdb::FloatGrid;
using openvdb::Int64Grid;
using openvdb::MetaMap;
using SamplesLeaf = openvdb::Int64Tree::LeafNodeType;

constexpr int kFormat = 1;

// A .vdb starts with magic (8 bytes), format (4), library version (8) and a flag (1), and a UUID as
// 36 letters. Ours starts with a mark ("soilvdb", as a UUID of version 8) and ends with a checksum.
constexpr std::size_t kUuidAt = 21, kUuidSize = 36;
constexpr std::string_view kMark = "736f696c-7664-8200-8";
constexpr std::string_view kTrailerWord = "soilvdb-crc64 ";
constexpr std::size_t kTrailerSize = kTrailerWord.size() + 16 + 1 + 16 + 1;

std::string trailer(std::string_view bytes) {
  return fmt::format("{}{:016x} {:016x}\n", kTrailerWord, crc64(bytes), bytes.size());
}

/// Writes as io::File does, with offsets for random access, into any stream that can seek.
class SeekableArchive : public openvdb::io::Archive {
 public:
  void write_to(std::ostream& out, const openvdb::GridCPtrVec& grids, const MetaMap& meta) const {
    Archive::write(out, grids, /*seekable=*/true, meta);
  }
};

void put(MetaMap& meta, const char* name, const std::string& value) {
  if (!value.empty()) meta.insertMeta(name, openvdb::StringMetadata(value));
}
void put(MetaMap& meta, const char* name, double value) {
  meta.insertMeta(name, openvdb::DoubleMetadata(value));
}

/// `to` as seen from `folder`; absolute if there is no way on the same file system tree.
std::string relative_to(const std::filesystem::path& folder, const std::filesystem::path& to) {
  std::error_code error;
  const std::filesystem::path from = std::filesystem::weakly_canonical(folder, error);
  const std::filesystem::path target = std::filesystem::weakly_canonical(to, error);
  const std::filesystem::path way = target.lexically_relative(from);
  return way.empty() ? target.string() : way.string();
}

void put_base(MetaMap& meta, const std::filesystem::path& snapshot, const BaseReference& base) {
  if (const auto* plane = std::get_if<PlaneTerrain>(&base.terrain)) {
    put(meta, "soilvdb_base", "plane");
    put(meta, "soilvdb_base_height_m", plane->height_m);
    put(meta, "soilvdb_base_slope_x", plane->slope.x());
    put(meta, "soilvdb_base_slope_y", plane->slope.y());
    return;
  }
  const auto* raster = std::get_if<RasterTerrain>(&base.terrain);
  const std::filesystem::path& file =
      raster != nullptr ? raster->file : std::get<LevelSetTerrain>(base.terrain).file;
  put(meta, "soilvdb_base", raster != nullptr ? "raster" : "level_set");
  put(meta, "soilvdb_base_file",
      relative_to(std::filesystem::absolute(snapshot).parent_path(), file));
  put(meta, "soilvdb_base_file_absolute", std::filesystem::absolute(file).string());
  put(meta, "soilvdb_base_checksum", base.checksum);
}

void put_all(MetaMap& meta, const std::filesystem::path& file, const Site& site,
             const SnapshotInfo& info) {
  const Soil& soil = *site.soil;
  const Vec3& origin = soil.origin();
  meta.insertMeta("soilvdb_format", openvdb::Int32Metadata(kFormat));
  put(meta, "soilvdb_version", SOILVDB_VERSION);
  put(meta, "soilvdb_voxel_size_m", soil.voxel_size_m());
  meta.insertMeta(kOriginKey, openvdb::Vec3DMetadata({origin.x(), origin.y(), origin.z()}));
  put(meta, kCrsKey, site.crs_wkt);
  put(meta, "soilvdb_scenario", info.scenario);
  put(meta, "soilvdb_time_s", info.time_s);
  put(meta, "soilvdb_cut_m3", info.cut_m3);
  put(meta, "soilvdb_captured_m3", info.captured_m3);
  put(meta, "soilvdb_displaced_m3", info.displaced_m3);
  put(meta, "soilvdb_dumped_m3", info.dumped_m3);
  put(meta, "soilvdb_state_hash", fmt::format("{:016x}", soil.state_hash()));
  put_base(meta, file, site.reference);
}

/// A leaf per chunk. Voxels that are all soil (-1) or all air (0) are inactive, which is what the
/// file's compression leaves out.
Int64Grid::Ptr samples_grid(const Soil& soil) {
  Int64Grid::Ptr grid = Int64Grid::create(0);
  grid->setName("samples");
  grid->setTransform(soil.grids().surface().transform().copy());
  SampleWords words;
  for (const Chunk* chunk : soil.chunks()) {
    const Coord3& o = chunk->origin;
    chunk->samples.expand(words);
    auto* leaf = new SamplesLeaf(openvdb::Coord(o.x(), o.y(), o.z()), 0);
    for (openvdb::Index n = 0; n < SamplesLeaf::SIZE; ++n) {
      const auto value = static_cast<std::int64_t>(words[n]);
      leaf->setValueOnly(n, value);
      leaf->setActiveState(n, value != 0 && value != -1);
    }
    grid->tree().addLeaf(leaf);
  }
  return grid;
}

std::string read_all(const std::filesystem::path& file) {
  check_readable(file);
  std::ifstream in(file, std::ios::binary);
  std::string bytes(std::filesystem::file_size(file), '\0');
  if (!in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()))) {
    throw InputError(file, "can't be read to its end");
  }
  return bytes;
}

void check_intact(const std::filesystem::path& file) {
  const std::string bytes = read_all(file);
  const std::string_view all = bytes;
  const std::size_t end = all.size() - std::min(all.size(), kTrailerSize);
  if (!all.substr(end).starts_with(kTrailerWord)) {
    throw InputError(file, "is damaged: its end is missing; use a snapshot before it");
  }
  if (all.substr(end) != trailer(all.substr(0, end))) {
    throw InputError(file, "is damaged: its checksum doesn't match; use a snapshot before it");
  }
}

/// Metadata that a snapshot must have.
class Reader {
 public:
  Reader(const std::filesystem::path& file, const MetaMap& meta) : file_(file), meta_(meta) {}

  double number(const char* name) const { return need<double>(name); }
  openvdb::Vec3d vector(const char* name) const { return need<openvdb::Vec3d>(name); }
  int integer(const char* name) const { return need<std::int32_t>(name); }
  /// Empty strings are left out of a file.
  std::string text(const char* name) const {
    const auto value = meta_.getMetadata<openvdb::StringMetadata>(name);
    return value ? value->value() : "";
  }

 private:
  template <typename T>
  T need(const char* name) const {
    const auto value = meta_.getMetadata<openvdb::TypedMetadata<T>>(name);
    if (!value) throw InputError(file_, fmt::format("is no snapshot: it has no {}", name));
    return value->value();
  }

  const std::filesystem::path& file_;
  const MetaMap& meta_;
};

Base open_referenced(const std::filesystem::path& snapshot, const Reader& meta) {
  const std::string kind = meta.text("soilvdb_base");
  if (kind == "plane") {
    return open_base(PlaneTerrain{
        meta.number("soilvdb_base_height_m"),
        {meta.number("soilvdb_base_slope_x"), meta.number("soilvdb_base_slope_y")}});
  }
  if (kind != "raster" && kind != "level_set") {
    throw InputError(snapshot, fmt::format("has a base surface of unknown kind '{}'; a newer soilvdb "
                                           "may read it", printable(kind)));
  }
  // The file may have moved together with the snapshot, or the snapshot alone.
  std::error_code none;
  std::filesystem::path file = (std::filesystem::absolute(snapshot).parent_path() /
                                meta.text("soilvdb_base_file")).lexically_normal();
  const std::filesystem::path other = meta.text("soilvdb_base_file_absolute");
  const std::string checksum = meta.text("soilvdb_base_checksum");
  const auto matches = [&](const std::filesystem::path& path) {
    return std::filesystem::is_regular_file(path, none) && file_fingerprint(path) == checksum;
  };
  if (!matches(file)) {
    if (matches(other)) {
      file = other;
    } else if (!std::filesystem::exists(file, none) && !std::filesystem::exists(other, none)) {
      throw InputError(snapshot, fmt::format("its base surface {} is missing; put it back there",
                                             file.string()));
    } else {
      if (!std::filesystem::exists(file, none)) file = other;
      throw InputError(snapshot, fmt::format("its base surface {} has changed since; put back the "
                                             "file the ground was dug from", file.string()));
    }
  }
  if (kind == "raster") return open_base(RasterTerrain{file});
  return open_base(LevelSetTerrain{file});
}

/// @throw std::exception on anything that isn't as write_snapshot() makes it.
void restore(Soil& soil, const FloatGrid& surface, const Int64Grid& samples) {
  std::size_t leaves = 0;
  SampleWords words;
  for (auto leaf = surface.tree().cbeginLeaf(); leaf; ++leaf, ++leaves) {
    const auto* other = samples.tree().probeConstLeaf(leaf->origin());
    if (other == nullptr) throw std::runtime_error("its grids don't cover the same ground");
    for (openvdb::Index n = 0; n < kLeafSize; ++n) {
      words[n] = static_cast<std::uint64_t>(other->getValue(n));
    }
    const openvdb::Coord o = leaf->origin();
    soil.restore({o.x(), o.y(), o.z()}, leaf->buffer().data(), words);
  }
  if (leaves != samples.tree().leafCount()) {
    throw std::runtime_error("its grids don't cover the same ground");
  }
}

Site read_site(const std::filesystem::path& file, SnapshotInfo* info) {
  openvdb::initialize();
  openvdb::io::File vdb(file.string());
  vdb.open(/*delayLoad=*/false);
  const MetaMap::Ptr all = vdb.getMetadata();
  const Reader meta(file, *all);
  if (const int format = meta.integer("soilvdb_format"); format != kFormat) {
    throw InputError(file, fmt::format("is a snapshot of format {}; this version reads format {}",
                                       format, kFormat));
  }
  const auto surface = openvdb::gridPtrCast<FloatGrid>(vdb.readGrid("surface"));
  const auto samples = openvdb::gridPtrCast<Int64Grid>(vdb.readGrid("samples"));
  if (!surface || !samples) throw std::runtime_error("its grids are not of the right types");

  Base base = open_referenced(file, meta);
  const openvdb::Vec3d origin = meta.vector(kOriginKey);
  Site site;
  site.soil = std::make_unique<Soil>(meta.number("soilvdb_voxel_size_m"),
                                     Vec3(origin.x(), origin.y(), origin.z()), base.surface);
  site.reference = std::move(base.reference);
  site.crs_wkt = meta.text(kCrsKey);
  site.bounds = base.bounds;
  restore(*site.soil, *surface, *samples);
  if (fmt::format("{:016x}", site.soil->state_hash()) != meta.text("soilvdb_state_hash")) {
    throw std::runtime_error("its ground is not what was written");
  }
  if (info != nullptr) {
    *info = {meta.text("soilvdb_scenario"),       meta.number("soilvdb_time_s"),
             meta.number("soilvdb_cut_m3"),       meta.number("soilvdb_captured_m3"),
             meta.number("soilvdb_displaced_m3"), meta.number("soilvdb_dumped_m3")};
  }
  return site;
}

}  // namespace

std::string snapshot_bytes(const std::filesystem::path& file, const Site& site,
                           const SnapshotInfo& info) {
  openvdb::initialize();
  MetaMap meta;
  put_all(meta, file, site, info);
  // A grid of its own metadata that shares the soil's tree.
  const FloatGrid& soil_grid = site.soil->grids().surface();
  MetaMap of_grid = soil_grid;
  for (auto item = meta.beginMeta(); item != meta.endMeta(); ++item) {
    of_grid.insertMeta(item->first, *item->second);
  }
  const FloatGrid::ConstPtr surface = soil_grid.copyReplacingMetadata(of_grid);
  std::ostringstream out(std::ios::binary);
  SeekableArchive archive;
  archive.setCompression((openvdb::io::Archive::hasBloscCompression()
                              ? openvdb::io::COMPRESS_BLOSC
                              : openvdb::io::COMPRESS_ZIP) |
                         openvdb::io::COMPRESS_ACTIVE_MASK);
  archive.write_to(out, {surface, samples_grid(*site.soil)}, meta);
  if (!out) throw std::runtime_error(file.string() + ": can't be written: out of memory");
  std::string bytes = std::move(out).str();
  // OpenVDB draws the UUID at random; ours is the mark and a digest of the rest.
  std::string_view head = std::string_view(bytes).substr(kUuidAt, kUuidSize);
  if (head.size() != kUuidSize || head[8] != '-' || head[23] != '-') {
    throw std::runtime_error(file.string() + ": can't be written: this OpenVDB's file header is not "
                             "the known one");
  }
  const std::uint64_t digest = crc64(std::string_view(bytes).substr(kUuidAt + kUuidSize));
  const std::string uuid = fmt::format("{}{:03x}-{:012x}", kMark, digest >> 52,
                                       digest & ((std::uint64_t{1} << 48) - 1));
  bytes.replace(kUuidAt, kUuidSize, uuid);
  return bytes += trailer(bytes);
}

void write_snapshot(const std::filesystem::path& file, const Site& site, const SnapshotInfo& info) {
  write_atomically(file, snapshot_bytes(file, site, info));
}

bool is_snapshot(const std::filesystem::path& file) {
  std::error_code none;
  if (!std::filesystem::is_regular_file(file, none)) return false;
  std::ifstream in(file, std::ios::binary);
  std::string head(kUuidAt + kUuidSize, '\0'), end(kTrailerSize, '\0');
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  if (std::string_view(head).substr(kUuidAt).starts_with(kMark)) return true;
  in.clear();
  in.seekg(-static_cast<std::streamoff>(kTrailerSize), std::ios::end);
  in.read(end.data(), static_cast<std::streamsize>(end.size()));
  return in && end.starts_with(kTrailerWord);
}

Site read_snapshot(const std::filesystem::path& file, SnapshotInfo* info) {
  check_readable(file);
  if (!is_snapshot(file)) {
    throw InputError(file, "is not a snapshot; one that `soilvdb run` wrote would do");
  }
  check_intact(file);
  try {
    return read_site(file, info);
  } catch (const InputError&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(file, fmt::format("is damaged ({})", printable(error.what())));
  }
}

}  // namespace soilvdb::io
