// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A session as a snapshot, as bytes and as a clone.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "core/lattice/bytes.h"
#include "io/file/json.h"
#include "io/snapshot/snapshot_samples.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "tools/run/session_state.h"

namespace soilvdb::inline v0 {
namespace {

constexpr std::string_view kMagic = "soilvdb state";
constexpr std::uint32_t kVersion = 4;
constexpr double kSamePost = 1e-6;  // of a cell: a GeoTIFF's rounding

/// Has a file these heights, and can it be read?
bool holds(const std::filesystem::path& file, const io::RasterHeights& heights) {
  try {
    const io::RasterInput raster = io::open_raster(file);
    const auto& [grid, values] = heights;
    std::vector<float> there(values.size());
    if (raster.grid.nx != grid.nx || raster.grid.ny != grid.ny) return false;
    raster.source->read(0, 0, grid.nx, grid.ny, there.data());
    return (raster.grid.first - grid.first).norm() < kSamePost * grid.spacing.x() &&
           (raster.grid.spacing - grid.spacing).norm() < kSamePost * grid.spacing.x() &&
           std::equal(values.begin(), values.end(), there.begin(),
                      [](float a, float b) { return a == b || (std::isnan(a) && std::isnan(b)); });
  } catch (const std::exception&) {
    return false;
  }
}

/// Of a site's description, if it has one on the earth.
std::optional<Vec3> origin_of(const nlohmann::json& site) {
  const auto found = site.is_object() ? site.find("origin_m") : site.end();
  if (found == site.end() || !found->is_array() || found->size() != 3) return {};
  Vec3 origin;
  for (Eigen::Index i = 0; i < 3; ++i) {
    const nlohmann::json& number = (*found)[static_cast<std::size_t>(i)];
    if (!number.is_number()) return {};
    origin[i] = number.get<double>();
  }
  return is_place(origin) ? std::optional(origin) : std::nullopt;
}

}  // namespace

void Session::write(const std::filesystem::path& file) const {
  if (file.extension() != ".vdb")
    throw std::invalid_argument(
        fmt::format("{}: a session writes a snapshot; its name must end with .vdb", file.string()));
  io::SnapshotInfo info = state_->snapshot_info(state_->last_s().value_or(0));
  info.tracker_state.clear();
  const io::Site& site = state_->site;
  const auto* raster = std::get_if<io::RasterTerrain>(&site.reference.terrain);
  if (raster == nullptr || !raster->heights) return io::write_snapshot(file, site, info);
  // A snapshot names its terrain's file. Its name is that of its content, so it is never replaced.
  const std::filesystem::path beside =
      file.parent_path() / fmt::format("terrain_{}.tif", site.reference.checksum);
  const bool is_new = !std::filesystem::exists(beside);
  io::Site named = io::undug_site(site);
  named.ground = site.ground;
  if (is_new || !holds(beside, *raster->heights))
    io::write_geotiff(beside, raster->heights->grid, {{"terrain", raster->heights->values}}, "");
  try {
    named.reference = io::open_base(io::RasterTerrain{beside}).reference;
    io::write_snapshot(file, named, info);
  } catch (...) {
    std::error_code none;
    if (is_new) std::filesystem::remove(beside, none);
    throw;
  }
}

std::string Session::save() const {
  const State& s = *state_;
  if (!s.broken_.empty()) throw std::runtime_error(s.broken_);
  std::string rest;
  put_text(rest, io::to_cbor(s.description(/*with_ground=*/false)));
  put_text(rest, s.progress());
  put_text(rest, io::samples_bytes(*s.site.ground, {}));
  std::string out(kMagic);
  put(out, kVersion);
  put(out, io::crc64(rest));
  return out + rest;
}

void Session::restore(std::string_view bytes) {
  State& s = *state_;
  if (s.recorder) throw std::invalid_argument("a recorded session can't be restored; clone it");
  if (bytes.substr(0, kMagic.size()) != kMagic)
    throw std::invalid_argument("not a saved state (expected bytes from save())");
  bytes.remove_prefix(kMagic.size());
  std::uint32_t version = 0;
  take(bytes, version);
  if (version != kVersion)
    throw std::invalid_argument(
        fmt::format("the state has version {}; this program has {}", version, kVersion));
  std::uint64_t checksum = 0;
  take(bytes, checksum);
  if (checksum != io::crc64(bytes))
    throw std::invalid_argument("the state is damaged: its checksum doesn't match");
  const auto site = io::from_cbor(take_text(bytes));
  nlohmann::json own = s.description(/*with_ground=*/false);
  // One site on an endless plane, though its work may have begun elsewhere.
  const std::optional<Vec3> origin = s.settings.floats ? origin_of(site) : std::nullopt;
  if (origin) own["origin_m"] = io::numbers(*origin);
  if (const std::string what = difference(site, own); !what.empty())
    throw std::invalid_argument(fmt::format("the state is of another site: {} differs", what));
  const std::string_view progress = take_text(bytes);
  io::Site undug = io::undug_site(s.site);
  if (origin && *origin != s.site.ground->origin())
    undug = io::open_site(undug.reference.terrain, s.site.ground->voxel_size_m(), origin);
  tools::SiteState restored(s.model(), std::move(undug));
  try {
    io::restore_samples(take_text(bytes), *restored.site.ground);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& e) {  // also OpenVDB's exceptions
    throw std::invalid_argument(e.what());
  }
  restored.set_progress(progress);
  s.become(std::move(restored));
  ++s.fed_count;
}

Session Session::clone() const {
  const State& s = *state_;
  if (!s.broken_.empty()) throw std::runtime_error(s.broken_);
  if (s.settings.memory_bytes != 0)
    throw std::runtime_error("a session whose memory is limited can't be cloned");
  return Session(std::make_unique<State>(s));
}

}  // namespace soilvdb::inline v0
