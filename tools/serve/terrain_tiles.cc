// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/terrain_tiles.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "core/lattice/bytes.h"
#include "soilvdb/io/picture.h"
#include "soilvdb/io/raster.h"

namespace soilvdb::tools {
namespace {

/// Margin around work on unbounded ground.
constexpr double kAround_m = 40;
/// Posts along the longer side of a terrain without posts of its own.
constexpr double kPosts = 512;

}  // namespace

Eigen::AlignedBox2d work_area(const Session& session) {
  Eigen::AlignedBox2d area = io::footprint(*session.site().ground, false);
  const auto add = [&](const Vec3& p) { area.extend(Vec2(p.head<2>())); };
  for (std::size_t i = 0; i < session.machines().size(); ++i) {
    if (const auto last = session.last(i)) add(last->pose.position);
    if (session.machines()[i].chain) add(session.base(i).position);
  }
  for (const Pour& pour : session.earthmoving().pours) add(pour.at_m);
  for (const Hopper& hopper : session.earthmoving().hoppers) area.extend(hopper.box_m);
  return area;
}

TerrainTiles::TerrainTiles(const io::Site& site, const Eigen::AlignedBox2d& work)
    : base_(site.ground->shared_terrain()),
      undug_(&site.ground->initial_terrain()),
      bounds_(site.bounds) {
  double spacing_m = 0;
  if (const auto* raster = std::get_if<io::RasterTerrain>(&site.undug().terrain))
    spacing_m = io::open_raster(raster->file).grid.spacing.minCoeff();
  if (bounds_.isEmpty() || !bounds_.min().allFinite() || !bounds_.max().allFinite()) {
    bounds_ = work;
    if (bounds_.isEmpty()) bounds_.extend(Vec2::Zero().eval());
    const Vec2 around = Vec2::Constant(kAround_m);
    bounds_ = {(bounds_.min() - around).array().floor().matrix(),
               (bounds_.max() + around).array().ceil().matrix()};
  }
  const double side_m = bounds_.sizes().maxCoeff();
  if (spacing_m == 0) spacing_m = side_m / kPosts;
  // Limits the number of posts.
  while (side_m / spacing_m > 1e6) spacing_m *= 2;
  for (;; spacing_m *= 2) {
    const auto posts = [&](double length_m) {
      return static_cast<int>(std::ceil(length_m / spacing_m - 1e-6)) + 1;
    };
    levels_.push_back({spacing_m, posts(bounds_.sizes().x()), posts(bounds_.sizes().y())});
    if (std::max(levels_.back().nx, levels_.back().ny) <= kSide + 1) break;
  }
}

nlohmann::ordered_json TerrainTiles::description() const {
  nlohmann::ordered_json json = {
      {"bounds", {bounds_.min().x(), bounds_.min().y(), bounds_.max().x(), bounds_.max().y()}},
      {"tile", kSide},
      {"levels", nlohmann::ordered_json::array()}};
  for (const Level& level : levels_)
    json["levels"].push_back({{"spacing_m", level.spacing_m}, {"nx", level.nx}, {"ny", level.ny}});
  return json;
}

std::optional<std::string> TerrainTiles::tile(int level, int i, int j,
                                              const InitialTerrain* other) const {
  if (level < 0 || level >= static_cast<int>(levels_.size())) return {};
  const Level& of = levels_[static_cast<std::size_t>(level)];
  if (i < 0 || j < 0 || i > (of.nx - 2) / kSide || j > (of.ny - 2) / kSide) return {};
  const InitialTerrain& surface = other != nullptr ? *other : *undug_;
  std::string bytes;
  for (int y = j * kSide; y <= std::min((j + 1) * kSide, of.ny - 1); ++y) {
    for (int x = i * kSide; x <= std::min((i + 1) * kSide, of.nx - 1); ++x) {
      // The last post, beyond the border, takes the border's height.
      const Vec2 at = (bounds_.min() + of.spacing_m * Vec2(x, y)).cwiseMin(bounds_.max());
      put(bytes,
          static_cast<float>(
              surface.height(at.x(), at.y()).value_or(std::numeric_limits<double>::quiet_NaN())));
    }
  }
  return bytes;
}

}  // namespace soilvdb::tools
