// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/ground_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/lattice/chunk_math.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

Json or_null(double value) { return std::isfinite(value) ? Json(value) : Json(); }

Json all_of(const Heights& heights, const std::vector<Vec2>& places) {
  std::vector<double> z(places.size());
  heights(places, z);
  Json all = Json::array();
  for (const double value : z) all.push_back(or_null(value));
  return all;
}

}  // namespace

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
  const BoundaryVolume all = volume_inside(site, before, boundary, now_heights(), design_.get());
  Json json = {{"area_m2", all.area_m2}, {"off_site_m2", all.off_site_m2},
               {"cut_m3", all.cut_m3},   {"fill_m3", all.fill_m3},
               {"net_m3", all.net_m3},   {"error_m3", all.error_m3}};
  if (!all.to_design) return json;
  const bool compared = all.to_design->area_m2 > 0;
  json["design_area_m2"] = all.to_design->area_m2;
  json["to_cut_m3"] = compared ? Json(all.to_design->cut_m3) : Json();
  json["to_fill_m3"] = compared ? Json(all.to_design->fill_m3) : Json();
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
