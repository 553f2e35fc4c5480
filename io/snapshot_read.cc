// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reading snapshots.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <new>
#include <system_error>
#include <utility>

#include "core/soil_grids.h"
#include "io/level_set_file.h"
#include "io/snapshot.h"
#include "io/snapshot_format.h"
#include "io/text.h"

namespace soilvdb::io {
namespace {

using openvdb::FloatGrid;
using openvdb::Int64Grid;
using openvdb::MetaMap;

std::string read_all(const std::filesystem::path& file) {
  check_readable(file);
  std::ifstream in(file, std::ios::binary);
  std::string bytes(std::filesystem::file_size(file), '\0');
  if (!in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()))) {
    throw InputError(file, "can't be read to its end");
  }
  return bytes;
}

/// Checks that a file is what was written. @return the tracker's state in it
std::string check_intact(const std::filesystem::path& file) {
  const std::string bytes = read_all(file);
  const std::string_view all = bytes;
  const std::size_t end = all.size() - std::min(all.size(), kTrailerSize);
  if (!all.substr(end).starts_with(kTrailerWord)) {
    throw InputError(file, "is damaged: its end is missing; use a snapshot before it");
  }
  if (all.substr(end) != trailer(all.substr(0, end))) {
    throw InputError(file, "is damaged: its checksum doesn't match; use a snapshot before it");
  }
  const std::string_view line = all.substr(0, end).substr(end - std::min(end, kStateLine));
  std::uint64_t size = 0;
  const char* digits = line.data() + kStateWord.size();
  if (!line.starts_with(kStateWord) ||
      std::from_chars(digits, digits + 16, size, 16).ptr != digits + 16 || size > end - kStateLine)
    return "";
  return std::string(all.substr(end - kStateLine - size, size));
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
    return open_base(
        PlaneTerrain{meta.number("soilvdb_base_height_m"),
                     {meta.number("soilvdb_base_slope_x"), meta.number("soilvdb_base_slope_y")}});
  }
  if (kind != "raster" && kind != "level_set") {
    throw InputError(snapshot,
                     fmt::format("has a base surface of unknown kind '{}'; a newer soilvdb "
                                 "may read it",
                                 printable(kind)));
  }
  // The file may have moved together with the snapshot, or the snapshot alone.
  std::error_code none;
  std::filesystem::path file =
      (std::filesystem::absolute(snapshot).parent_path() / meta.text("soilvdb_base_file"))
          .lexically_normal();
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
                                             "file the ground was dug from",
                                             file.string()));
    }
  }
  if (kind == "raster") return open_base(RasterTerrain{file});
  return open_base(LevelSetTerrain{file});
}

/// @throw std::exception on anything that isn't as write_snapshot() makes it.
void restore(Soil& soil, const FloatGrid& surface, const Int64Grid& samples,
             const openvdb::Int32Grid& base_samples) {
  std::size_t leaves = 0;
  SampleWords words;
  for (auto leaf = surface.tree().cbeginLeaf(); leaf; ++leaf, ++leaves) {
    const auto* other = samples.tree().probeConstLeaf(leaf->origin());
    if (other == nullptr) throw std::runtime_error("its grids don't cover the same ground");
    for (openvdb::Index n = 0; n < kLeafSize; ++n) {
      words[n] = static_cast<std::uint64_t>(other->getValue(n));
    }
    const openvdb::Coord o = leaf->origin();
    const auto base =
        base_samples.tree().getValue({o.x() / kLeafSide, o.y() / kLeafSide, o.z() / kLeafSide});
    soil.restore({o.x(), o.y(), o.z()}, leaf->buffer().data(), words,
                 static_cast<std::uint32_t>(base));
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
  const auto base_samples = openvdb::gridPtrCast<openvdb::Int32Grid>(vdb.readGrid("base_samples"));
  if (!surface || !samples || !base_samples)
    throw std::runtime_error("its grids are not of the right types");

  Base base = open_referenced(file, meta);
  const openvdb::Vec3d origin = meta.vector(kOriginKey);
  Site site;
  site.soil = std::make_unique<Soil>(meta.number("soilvdb_voxel_size_m"),
                                     Vec3(origin.x(), origin.y(), origin.z()), base.surface);
  site.reference = std::move(base.reference);
  site.crs_wkt = meta.text(kCrsKey);
  site.bounds = base.bounds;
  restore(*site.soil, *surface, *samples, *base_samples);
  if (fmt::format("{:016x}", site.soil->state_hash()) != meta.text("soilvdb_state_hash")) {
    throw std::runtime_error("its ground is not what was written");
  }
  if (info != nullptr) {
    *info = {meta.text("soilvdb_scenario"),
             meta.number("soilvdb_time_s"),
             meta.number("soilvdb_cut_m3"),
             meta.number("soilvdb_captured_m3"),
             meta.number("soilvdb_displaced_m3"),
             meta.number("soilvdb_dumped_m3"),
             ""};
  }
  return site;
}

}  // namespace

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
  std::string tracker_state = check_intact(file);
  try {
    Site site = read_site(file, info);
    if (info != nullptr) info->tracker_state = std::move(tracker_state);
    return site;
  } catch (const InputError&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(file, fmt::format("is damaged ({})", printable(error.what())));
  }
}

}  // namespace soilvdb::io
