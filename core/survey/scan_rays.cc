// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What each ray of a scan says: of the column that it was to meet, or that the ground is another.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

#include "core/constants.h"
#include "core/survey/survey_state.h"

namespace soilvdb::inline v0 {
namespace {

/// Does a ray meet a box before its end?
bool meets(const Eigen::AlignedBox3d& box, const Vec3& from, const Vec3& to) {
  double begin = 0, end = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const double way = to[axis] - from[axis];
    if (way == 0) {
      if (from[axis] < box.min()[axis] || from[axis] > box.max()[axis]) return false;
      continue;
    }
    double near = (box.min()[axis] - from[axis]) / way, far = (box.max()[axis] - from[axis]) / way;
    if (near > far) std::swap(near, far);
    begin = std::max(begin, near);
    end = std::min(end, far);
  }
  return begin <= end;
}

/// The body of a bucket, in its frame, with what is about it.
Eigen::AlignedBox3d body_of(const Bucket& bucket) {
  Eigen::AlignedBox3d box;
  for (const Vec3& point : extremes(bucket)) box.extend(point);
  if (bucket.profile.empty() && !bucket.shape) box.extend(Vec3(-bucket.height_m, 0, 0));
  const Vec3 room = Vec3::Constant(kMaskRoomM);
  return {box.min() - room, box.max() + room};
}

std::int64_t in_units(double value, double unit) { return std::llround(value / unit); }

/// Of a residual or a height; what is farther is no residual.
std::int64_t height_units(double height_m) {
  return in_units(std::clamp(height_m, -kMostScanHeightM, kMostScanHeightM), kScanUnit_m);
}
std::int64_t weight_of(double sigma_m) {
  return std::max<std::int64_t>(1, std::llround(1 / (sigma_m * sigma_m)));
}

class Rays {
 public:
  Rays(SurveyState& state, const Sensor& sensor, int number)
      : state_(state), sensor_(sensor), number_(number), h_(state.voxel_m()) {}

  /// @param range_m to the ground as it is expected
  void take(const Vec3& point, double range_m) {
    const Vec3 way = point - sensor_.pose.position;
    const double length = way.norm();
    if (!(length > 0)) return;
    const Vec3 along = way / length;
    const double sigma =
        sensor_.range_sigma_m + sensor_.range_squared_sigma_per_m * length * length;
    RayCounts& rays = state_.rays;
    if (range_m == 0) {  // the sensor is below the ground
      ++rays.dropped;
      return;
    }
    if (std::isfinite(range_m)) {
      if (meet(along, length, range_m, sigma)) {
        ++rays.used;
        return;
      }
      if (length - range_m > kMostThroughM) {  // a mirror, such as water
        ++rays.dropped;
        return;
      }
      if (length > range_m)
        state_.through.push_back({sensor_.pose.position, point, range_m, sigma, state_.time});
    }
    if (!hit(point, along, length, sigma)) ++rays.dropped;
  }

 private:
  Coord2 column_at(const Vec3& p) const {
    const Vec3 at = state_.ground.index_from_world(p);
    return {cell_of(at.x()), cell_of(at.y())};
  }
  bool is_near(const Vec3& p) const {
    return state_.ground.index_from_world(p).head<2>().cwiseAbs().maxCoeff() < kMaxIndex;
  }
  SurveyTile& tile_of(const Coord2& column) {
    const Coord2 cell = floor_to(column, kChunkSide);
    if (last_ == nullptr || last_->cell != cell) {
      last_ = &state_.tile(cell);
      state_.news.insert(SurveyState::mark(cell));
    }
    return *last_;
  }
  /// How a height that a ray measures errs with its sensor's mount.
  std::array<std::int64_t, 4> sees(const Vec3& place, const Vec2& slope) const {
    const Vec3 arm = place - sensor_.pose.position;
    return {in_units(1, kScanLever_m), in_units(arm.x(), kScanLever_m),
            in_units(arm.y(), kScanLever_m),
            in_units(arm.z() - slope.dot(arm.head<2>()), kScanLever_m)};
  }
  /// Area in plan that a ray stands for, on level ground.
  static std::int64_t area_of(const Vec3& along, double length) {
    return std::llround(kScanArea * length * length / std::max(std::abs(along.z()), kLeastDescent));
  }
  /// The quarter of its column that a place is in.
  std::size_t quarter_of(const Vec3& p, const Coord2& cell) const {
    const Vec2 in = state_.ground.index_from_world(p).head<2>() - cell.cast<double>();
    const auto part = [](double at) {
      return static_cast<std::size_t>(std::clamp(4 * (at + 0.5), 0.0, 3.0));
    };
    return 4 * part(in.x()) + part(in.y());
  }

  /// Did a ray end about where it was to meet the ground? Tells the column there.
  bool meet(const Vec3& along, double length, double range_m, double sigma) {
    const Vec3 place = sensor_.pose.position + range_m * along;
    if (!is_near(place)) return false;
    const Coord2 cell = column_at(place);
    SurveyTile& tile = tile_of(cell);
    const std::size_t i = SurveyState::number_of(cell);
    SurveyColumn& column = tile.columns[i];
    if (std::isnan(column.top)) return false;
    const Vec2& slope = tile.slopes[i];
    const double descent = along.z() - slope.dot(along.head<2>());
    const double residual = (length - range_m) * descent;
    const double error = sigma * std::abs(descent) + kScanErrorM;
    if (descent > -kLeastDescent || slope.squaredNorm() >= kScanWallSlope * kScanWallSlope)
      return std::abs(length - range_m) < 3 * sigma + kWallGateM;  // which tells no height
    if (std::abs(residual) >= 3 * error + std::max(kScanGateM, h_)) return false;
    const std::int64_t r = height_units(residual) + height_units((column.top - column.first) * h_);
    tile.sums[number_][i].add(weight_of(error), r, sees(place, slope));
    ++column.rays;
    const Vec3 end = sensor_.pose.position + length * along;
    if (is_near(end)) {
      const Coord2 own_cell = column_at(end);
      SurveyColumn& own = tile_of(own_cell).columns[SurveyState::number_of(own_cell)];
      own.cells.add(quarter_of(end, own_cell), area_of(along, length));
      if (!std::isnan(own.first)) own.height += height_units(end.z() - state_.first_m(own));
    }
    return true;
  }

  /// A vote for the height at which a ray ended.
  bool hit(const Vec3& point, const Vec3& along, double length, double sigma) {
    if (!is_near(point)) return false;
    const Coord2 cell = column_at(point);
    SurveyTile& tile = tile_of(cell);
    const std::size_t i = SurveyState::number_of(cell);
    const double height = point.z() - state_.first_m(tile.columns[i]);
    if (!(std::abs(height) < kMostScanHeightM)) return false;
    const int bin = static_cast<int>(std::floor(height / kScanBinM));
    ScanHits& hits = tile.votes[static_cast<int>(i)].hits[bin][number_];
    ++hits.rays;
    hits.cells.add(quarter_of(point, cell), area_of(along, length));
    hits.height += height_units(height);
    hits.sums.add(weight_of(sigma * std::abs(along.z()) + kScanErrorM), 0, sees(point, {0, 0}));
    return true;
  }

  SurveyState& state_;
  const Sensor& sensor_;
  const int number_;
  const double h_;
  SurveyTile* last_ = nullptr;
};

}  // namespace

bool SurveyState::is_met(const Vec3& end) const {
  const Vec3 at = ground.index_from_world(end);
  const Coord2 cell(cell_of(at.x()), cell_of(at.y()));
  std::int64_t count = 0;
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      const Coord2 near = cell + Coord2(dx, dy);
      const auto tile = tiles.find(plan_key(floor_to(near, kChunkSide)));
      if (tile == tiles.end()) continue;
      const std::size_t i = number_of(near);
      const auto votes = tile->second.votes.find(static_cast<int>(i));
      if (votes == tile->second.votes.end()) continue;
      const int bin =
          static_cast<int>(std::floor((end.z() - first_m(tile->second.columns[i])) / kScanBinM));
      const auto& hits = votes->second.hits;
      for (auto of = hits.lower_bound(bin - 1); of != hits.end() && of->first <= bin + 1; ++of)
        for (const auto& [sensor, some] : of->second) count += some.rays;
    }
  }
  return count >= kScanVotes;
}

/// Votes of columns whose soil lies above rays, short of their ends. Only where other rays end as
/// well: mirrors and leaves let single rays end anywhere.
void SurveyState::see_through() {
  const double h = voxel_m();
  for (const ThroughRay& ray : through) {
    const Vec3 way = ray.to - ray.from;
    const double length = way.norm();
    const Vec3 along = way / length;
    const double step = h / std::max(along.head<2>().norm(), 0.3);
    const double end = length - std::max(kThroughShortM, 3 * ray.sigma_m);
    const double room = kThroughRoomM + 3.5 * ray.sigma_m * std::abs(along.z());
    if (!is_met(ray.to)) continue;
    bool any = false;
    std::optional<Coord2> last;
    for (double t = std::max(0.0, ray.met_m - kThroughBeforeM); t < end; t += step) {
      const Vec3 place = ray.from + t * along, at = ground.index_from_world(place);
      if (!(at.head<2>().cwiseAbs().maxCoeff() < kMaxIndex)) break;
      const Coord2 cell(cell_of(at.x()), cell_of(at.y()));
      SurveyTile& tile = tile_of(cell);
      const std::size_t i = number_of(cell);
      const SurveyColumn& column = tile.columns[i];
      const double ceiling = place.z() + room;
      if (!(ceiling < ground.origin().z() + h * column.top) || column.changed > ray.time) continue;
      news.insert(mark(tile.cell));
      ScanVotes& votes = tile.votes[static_cast<int>(i)];
      const std::int64_t height = height_units(ceiling - first_m(column));
      votes.ceiling = votes.through == 0 ? height : std::min(votes.ceiling, height);
      votes.through += last == cell ? 0 : 1;
      last = cell;
      any = true;
    }
    rays.through += any;
  }
  through.clear();
}

std::vector<Vec3> SurveyState::unmasked(const Sensor& sensor, std::span<const Vec3> points_m,
                                        std::span<const Pose* const> poses) {
  struct Body {
    Eigen::AlignedBox3d box;
    Eigen::Matrix3d rotation;  // bucket from world
    Vec3 offset, from;         // from: the sensor, in the bucket
  };
  std::vector<Body> bodies;
  for (std::size_t m = 0; m < poses.size(); ++m) {
    if (poses[m] == nullptr) continue;
    const Pose inverse = poses[m]->inverse();
    bodies.push_back({body_of(buckets[m]), inverse.rotation.toRotationMatrix(), inverse.position,
                      inverse * sensor.pose.position});
  }
  std::vector<Vec3> ends;
  for (const Vec3& point : points_m) {
    const bool masked = std::any_of(bodies.begin(), bodies.end(), [&](const Body& body) {
      return meets(body.box, body.from, body.rotation * point + body.offset);
    });
    if (masked) {
      ++rays.masked;
    } else if ((point - sensor.pose.position).squaredNorm() > 0) {
      ends.push_back(point);
    }
  }
  return ends;
}

void SurveyState::add_rays(const Sensor& sensor, int number, std::span<const Vec3> ends) {
  std::vector<Vec3> ways;
  for (const Vec3& end : ends) ways.push_back(end - sensor.pose.position);
  std::vector<double> ranges(ways.size());
  map.cast(std::span(&sensor.pose.position, 1), ways, ranges).check();
  is_solved = is_solved && ends.empty();
  Rays all(*this, sensor, number);
  for (std::size_t i = 0; i < ends.size(); ++i) all.take(ends[i], ranges[i]);
}

}  // namespace soilvdb::inline v0
