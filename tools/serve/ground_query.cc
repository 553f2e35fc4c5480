// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/ground_query.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>
#include <vector>

#include "core/lattice/bytes.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

Json or_null(double value) { return std::isfinite(value) ? Json(value) : Json(); }

std::vector<double> all_of(const Heights& heights, const std::vector<Vec2>& places) {
  std::vector<double> z(places.size());
  heights(places, z);
  return z;
}

constexpr int kMostParts = 100'000;

/// A line with points evenly along it. Each stands for the way half to its neighbours, in parts no
/// longer than a voxel if there are not too many.
class SectionLine {
 public:
  SectionLine(const Vec2& from, const Vec2& to, int points, double voxel_m)
      : points_(points), length_m_((to - from).norm()) {
    const double step_m = length_m_ / (points - 1);
    const double wanted = std::ceil(step_m / voxel_m - 1e-9);
    half_ = wanted > 1
                ? static_cast<int>(std::min(std::ceil(wanted / 2), double(kMostParts) / points))
                : 0;
    const int parts = half_ > 0 ? 2 * half_ * (points - 1) : points - 1;
    for (int i = 0; i < (half_ > 0 ? parts : points); ++i)
      places_.emplace_back(from + (half_ > 0 ? i + 0.5 : i) / parts * (to - from));
  }

  const std::vector<Vec2>& places() const { return places_; }
  double distance_m(int point) const { return length_m_ * point / (points_ - 1); }

  /// At each point, from heights at places(). Unknown parts do not count.
  Json at_points(const std::vector<double>& z) const {
    Json all = Json::array();
    for (int i = 0; i < points_; ++i) {
      if (half_ == 0) {
        all.push_back(or_null(z[static_cast<std::size_t>(i)]));
        continue;
      }
      double sum = 0, count = 0;
      const int middle = 2 * half_ * i;
      for (int k = std::max(0, middle - half_);
           k < std::min(middle + half_, static_cast<int>(z.size())); ++k) {
        const double value = z[static_cast<std::size_t>(k)];
        if (!std::isfinite(value)) continue;
        sum += value;
        ++count;
      }
      all.push_back(count > 0 ? Json(sum / count) : Json());
    }
    return all;
  }

  /// Areas of what lies lower and higher than before, m2.
  std::pair<double, double> cut_and_fill_m2(const std::vector<double>& before,
                                            const std::vector<double>& now) const {
    double cut_m2 = 0, fill_m2 = 0;
    const auto add = [&](double change_m, double way_m) {
      if (!std::isfinite(change_m)) return;
      (change_m < 0 ? cut_m2 : fill_m2) += std::abs(change_m) * way_m;
    };
    const double way_m =
        length_m_ / static_cast<double>(half_ > 0 ? places_.size() : places_.size() - 1);
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const double change_m = now[i] - before[i];
      if (half_ > 0) {
        add(change_m, way_m);
        continue;
      }
      if (i + 1 == places_.size()) break;
      const double next_m = now[i + 1] - before[i + 1];
      if (change_m * next_m >= 0) {
        add((change_m + next_m) / 2, way_m);
      } else {  // the lines cross: a triangle on each side
        const double split = change_m / (change_m - next_m);
        add(change_m / 2, way_m * split);
        add(next_m / 2, way_m * (1 - split));
      }
    }
    return {cut_m2, fill_m2};
  }

 private:
  int points_, half_ = 0;  ///< parts from a point half-way to the next; 0: heights of the points
  double length_m_;
  std::vector<Vec2> places_;
};

/// The cells of a map of sigmas: columns, or squares of them where these would be too many.
struct SigmaCells {
  explicit SigmaCells(const std::vector<Coord2>& squares) {
    constexpr double kMostCells = 1 << 20;
    constexpr int kMostAlong = 4096;  // what browsers draw as one picture
    Eigen::AlignedBox2i box;
    for (const Coord2& square : squares)
      box.extend(square).extend(square + Coord2::Constant(kChunkSide - 1));
    for (; !squares.empty(); side *= 2) {
      low = floor_to(box.min(), side);
      size = (box.max() - low) / side + Coord2::Ones();
      if (size.maxCoeff() <= kMostAlong && 1.0 * size.x() * size.y() <= kMostCells) break;
    }
  }
  std::size_t count() const {
    return static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y());
  }
  /// Of the cell that a column is in.
  std::size_t number(const Coord2& column) const {
    const Coord2 cell = (column - low) / side;
    return static_cast<std::size_t>(cell.y()) * static_cast<std::size_t>(size.x()) +
           static_cast<std::size_t>(cell.x());
  }
  /// The columns in the middle of cells, of squares of 8 x 8.
  std::vector<Coord2> middles(const std::vector<Coord2>& squares) const {
    std::vector<Coord2> columns;
    for (const Coord2& square : squares)
      for (int n = 0; n < kChunkSide * kChunkSide; ++n) {
        const Coord2 column = square + Coord2(n / kChunkSide, n % kChunkSide), in = column - low;
        if (in.x() % side == side / 2 && in.y() % side == side / 2) columns.push_back(column);
      }
    return columns;
  }

  int side = 1;  // columns
  Coord2 low = Coord2::Zero(), size = Coord2::Zero();
};

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

GroundQuery::GroundQuery(Past now, std::shared_ptr<Session> before,
                         std::shared_ptr<const InitialTerrain> design, Heights live)
    : now_(std::move(now.site)),
      before_(std::move(before)),
      log_(std::move(now.log)),
      design_(std::move(design)),
      live_(std::move(live)) {}

Json GroundQuery::state() const { return log_ ? site_state(*now_, *log_) : Json(); }

Heights GroundQuery::now_heights() {
  if (live_) return live_;
  return [this](std::span<const Vec2> xy_m, std::span<double> z) { now_->mesh_heights(xy_m, z); };
}

Heights GroundQuery::before_heights() {
  if (!before_) return heights_of(now_->site().ground->initial_terrain());
  return
      [this](std::span<const Vec2> xy_m, std::span<double> z) { before_->mesh_heights(xy_m, z); };
}

Json height_answer(const Vec2& at, const Heights& now, const Heights& before,
                   const InitialTerrain* design) {
  const std::vector<Vec2> places = {at};
  Json json = {{"height_m", or_null(all_of(now, places)[0])},
               {"before_m", or_null(all_of(before, places)[0])}};
  if (design != nullptr) json["design_m"] = or_null(all_of(heights_of(*design), places)[0]);
  return json;
}

Json GroundQuery::height(const Vec2& at) {
  return height_answer(at, now_heights(), before_heights(), design_.get());
}

Json GroundQuery::section(const Vec2& from, const Vec2& to, int points) {
  const SectionLine line(from, to, points, now_->voxel_size_m());
  Json distances = Json::array();
  for (int i = 0; i < points; ++i) distances.push_back(line.distance_m(i));
  const std::vector<double> before = all_of(before_heights(), line.places());
  const std::vector<double> now = all_of(now_heights(), line.places());
  const auto [cut_m2, fill_m2] = line.cut_and_fill_m2(before, now);
  Json json = {{"distance_m", distances},
               {"before_m", line.at_points(before)},
               {"now_m", line.at_points(now)},
               {"cut_m2", cut_m2},
               {"fill_m2", fill_m2}};
  if (design_) json["design_m"] = line.at_points(all_of(heights_of(*design_), line.places()));
  return json;
}

BoundaryVolume GroundQuery::inside(const std::vector<Vec2>& boundary) {
  const io::Site& site = now_->site();
  const io::Site undug = io::undug_site(site);
  const Ground& before = before_ ? *before_->site().ground : *undug.ground;
  return volume_inside(site, before, boundary, now_heights(), design_.get());
}

BoundaryVolume GroundQuery::inside_undug(const std::vector<Vec2>& boundary) const {
  const io::Site undug = io::undug_site(now_->site());
  return volume_inside(undug, *undug.ground, boundary, heights_of(undug.ground->initial_terrain()),
                       design_.get());
}

Json GroundQuery::volume(const std::vector<Vec2>& boundary) {
  const BoundaryVolume all = inside(boundary);
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

Sigmas GroundQuery::sigmas() {
  if (now_->lip_errors_m().empty()) return {};
  return [this](auto... all) { now_->sigmas(all...); };
}

std::string GroundQuery::sigma_map() {
  constexpr double kPerMetre = 1e4, kMost = 65534;
  constexpr std::uint16_t kNotSeen = 65535;
  constexpr std::size_t kAtOnce = 1 << 16;
  const std::vector<Coord2> squares = now_->seen_squares();
  const SigmaCells cells(squares);
  const double voxel_m = now_->voxel_size_m();
  const Vec2 origin = now_->origin().head<2>();
  std::vector<std::uint16_t> values(cells.count(), kNotSeen);
  const std::vector<Coord2> columns = cells.middles(squares);
  for (std::size_t begin = 0; begin < columns.size(); begin += kAtOnce) {
    const auto some = std::span(columns).subspan(begin, std::min(kAtOnce, columns.size() - begin));
    std::vector<Vec2> places;
    for (const Coord2& column : some) places.emplace_back(origin + voxel_m * column.cast<double>());
    std::vector<double> sigmas_m(places.size()), seen(places.size());
    now_->sigmas(places, sigmas_m, seen);
    for (std::size_t i = 0; i < places.size(); ++i)
      if (seen[i] == 1)
        values[cells.number(some[i])] =
            static_cast<std::uint16_t>(std::min(std::round(kPerMetre * sigmas_m[i]), kMost));
  }
  std::string out;
  put(out, (origin + voxel_m * (cells.low.cast<double>() - Vec2::Constant(0.5))).eval(),
      cells.side * voxel_m, static_cast<std::uint32_t>(cells.size.x()),
      static_cast<std::uint32_t>(cells.size.y()));
  for (const std::uint16_t value : values) put(out, value);
  return out;
}

std::string GroundQuery::block(const Coord3& block, std::uint32_t view) {
  const Ground& ground = *now_->site().ground;
  return block_message(ground, block, mesh_block(ground, block), view, before_heights(),
                       design_ ? heights_of(*design_) : Heights(),
                       now_->earthmoving().soil.has_value(),
                       before_ ? before_->site().ground.get() : nullptr);
}

}  // namespace soilvdb::tools
