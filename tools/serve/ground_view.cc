// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/ground_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "core/lattice/chunk_math.h"
#include "core/tool/polygon.h"
#include "soilvdb/difference.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
/// Sampling of a boundary's inside: the most cells, and the least number along a side.
constexpr double kMostCells = 250'000, kLeastAcross = 64;

Json or_null(double value) { return std::isfinite(value) ? Json(value) : Json(); }

Json all_of(const Heights& heights, const std::vector<Vec2>& places) {
  std::vector<double> z(places.size());
  heights(places, z);
  Json all = Json::array();
  for (const double value : z) all.push_back(or_null(value));
  return all;
}

/// Centres of a grid of cells inside a boundary.
std::vector<Vec2> places_in(const std::vector<Vec2>& boundary, double voxel_m) {
  Eigen::AlignedBox2d box;
  for (const Vec2& corner : boundary) box.extend(corner);
  const Vec2 size = box.sizes();
  const double fine_m = std::min(voxel_m, size.maxCoeff() / kLeastAcross);
  const double cell_m = std::max(fine_m, std::sqrt(box.volume() / kMostCells));
  const Eigen::Array2d cells = (size.array() / cell_m).ceil().max(1).min(kMostCells);
  std::vector<Vec2> places;
  for (double j = 0.5; j < cells.y(); ++j)
    for (double i = 0.5; i < cells.x(); ++i)
      if (const Vec2 at = box.min().array() + size.array() * Eigen::Array2d(i, j) / cells;
          inside(boundary, at))
        places.push_back(at);
  return places;
}

}  // namespace

Heights heights_of(const InitialTerrain& surface) {
  return [&surface](std::span<const Vec2> xy_m, std::span<double> heights_m) {
    for (std::size_t i = 0; i < xy_m.size(); ++i)
      heights_m[i] = surface.height(xy_m[i].x(), xy_m[i].y()).value_or(kNaN);
  };
}

std::vector<Coord3> resident_blocks(const Ground& ground) {
  std::vector<Coord3> origins;
  for (const Chunk* chunk : ground.chunks()) {
    const Coord3 block = floor_to(chunk->origin, kBlockSide);
    if (origins.empty() || origins.back() != block) origins.push_back(block);
  }
  sort_once(origins);
  return origins;
}

GroundView::GroundView(Past now, std::shared_ptr<Session> before,
                       std::shared_ptr<const InitialTerrain> design)
    : now_(std::move(now.site)),
      before_(std::move(before)),
      log_(std::move(now.log)),
      design_(std::move(design)) {}

Json GroundView::state() const { return log_ ? site_state(*now_, *log_) : Json(); }

Heights GroundView::now_heights() {
  return [this](std::span<const Vec2> xy_m, std::span<double> z) { now_->mesh_heights(xy_m, z); };
}

Heights GroundView::before_heights() {
  if (!before_) return heights_of(now_->site().ground->initial_terrain());
  return
      [this](std::span<const Vec2> xy_m, std::span<double> z) { before_->mesh_heights(xy_m, z); };
}

Json GroundView::height(const Vec2& at) {
  const std::vector<Vec2> places = {at};
  Json json = {{"height_m", all_of(now_heights(), places)[0]},
               {"before_m", all_of(before_heights(), places)[0]}};
  if (design_) json["design_m"] = all_of(heights_of(*design_), places)[0];
  return json;
}

Json GroundView::section(const Vec2& from, const Vec2& to, int points) {
  std::vector<Vec2> places;
  Json distances = Json::array();
  for (int i = 0; i < points; ++i) {
    const double share = double(i) / (points - 1);
    places.emplace_back(from + share * (to - from));
    distances.push_back(share * (to - from).norm());
  }
  Json json = {{"distance_m", distances},
               {"before_m", all_of(before_heights(), places)},
               {"now_m", all_of(now_heights(), places)}};
  if (design_) json["design_m"] = all_of(heights_of(*design_), places);
  return json;
}

Json GroundView::volume(const std::vector<Vec2>& boundary) {
  const io::Site& site = now_->site();
  const io::Site undug = io::undug_site(site);
  const Ground& before = before_ ? *before_->site().ground : *undug.ground;
  const Difference change = difference(before, *site.ground, boundary);
  const std::vector<Vec2> places = places_in(boundary, site.ground->voxel_size_m());
  std::vector<double> ground(places.size());
  heights_of(site.ground->initial_terrain())(places, ground);
  const auto off_site =
      std::count_if(ground.begin(), ground.end(), [](double z) { return std::isnan(z); });
  const auto all = static_cast<std::ptrdiff_t>(places.size());
  if (all > 0 && off_site == all)
    throw std::invalid_argument(fmt::format(
        "there is no ground inside the boundary: the terrain goes from {:.0f}, {:.0f} to {:.0f}, "
        "{:.0f}",
        site.bounds.min().x(), site.bounds.min().y(), site.bounds.max().x(),
        site.bounds.max().y()));
  const double cell_m2 = change.area_m2 / static_cast<double>(std::max<std::ptrdiff_t>(all, 1));
  const double off_site_m2 = static_cast<double>(off_site) * cell_m2;
  Json json = {{"area_m2", change.area_m2 - off_site_m2},
               {"off_site_m2", off_site_m2},
               {"cut_m3", change.cut_m3},
               {"fill_m3", change.fill_m3},
               {"net_m3", change.net_m3},
               {"error_m3", change.error_m3}};
  if (!design_) return json;
  std::vector<double> now(places.size()), wanted(places.size());
  now_heights()(places, now);
  heights_of (*design_)(places, wanted);
  double cut_m = 0, fill_m = 0, compared = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double above_m = now[i] - wanted[i];
    if (std::isnan(above_m)) continue;
    ++compared;
    (above_m > 0 ? cut_m : fill_m) += std::abs(above_m);
  }
  json["design_area_m2"] = compared * cell_m2;
  json["to_cut_m3"] = compared > 0 ? Json(cut_m * cell_m2) : Json();
  json["to_fill_m3"] = compared > 0 ? Json(fill_m * cell_m2) : Json();
  return json;
}

std::string GroundView::block(const Coord3& block, std::uint32_t view) {
  const Ground& ground = *now_->site().ground;
  return block_message(ground, block, mesh_block(ground, block), view, before_heights(),
                       design_ ? heights_of(*design_) : Heights(),
                       now_->earthmoving().soil.has_value(),
                       before_ ? before_->site().ground.get() : nullptr);
}

}  // namespace soilvdb::tools
