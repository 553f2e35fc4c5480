// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What each ray of a scan says: of the column that it was to meet, or that the ground is another.
#include <algorithm>
#include <cmath>
#include <cstdint>

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
      switch (meet(along, length, range_m, sigma)) {
        case Meeting::kExpected: ++rays.used; return;
        case Meeting::kWall: ++rays.used; return;
        case Meeting::kOther: break;
      }
    }
    const bool gone = std::isfinite(range_m) && length > range_m && go_through(along, length, range_m, sigma);
    if (gone) ++rays.through;
    if (!hit(point, along, length, sigma) && !gone) ++rays.dropped;
  }

 private:
  enum class Meeting { kExpected, kWall, kOther };

  Coord2 column_at(const Vec3& p) const {
    const Vec3 at = state_.ground.index_from_world(p);
    return {cell_of(at.x()), cell_of(at.y())};
  }
  bool is_near(const Vec3& p) const {
    return state_.ground.index_from_world(p).head<2>().cwiseAbs().maxCoeff() < kMaxIndex;
  }
  SurveyTile& tile_of(const Coord2& column) {
    const Coord2 cell = floor_to(column, kChunkSide);
    if (last_ == nullptr || last_->cell != cell) last_ = &state_.tile(cell);
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

  Meeting meet(const Vec3& along, double length, double range_m, double sigma) {
    const Vec3 place = sensor_.pose.position + range_m * along;
    if (!is_near(place)) return Meeting::kOther;
    const Coord2 cell = column_at(place);
    SurveyTile& tile = tile_of(cell);
    const std::size_t i = SurveyState::number_of(cell);
    SurveyColumn& column = tile.columns[i];
    if (std::isnan(column.top)) return Meeting::kOther;
    const Vec2& slope = tile.slopes[i];
    const double descent = along.z() - slope.dot(along.head<2>());
    const double residual = (length - range_m) * descent;
    if (slope.squaredNorm() >= kWallSlope * kWallSlope)
      return std::abs(length - range_m) < 3 * sigma + kWallGateM ? Meeting::kWall : Meeting::kOther;
    const double error = sigma * std::abs(descent) + kScanErrorM;
    if (descent > -kLeastDescent || std::abs(residual) >= 3 * error + std::max(kScanGateM, h_))
      return Meeting::kOther;
    auto& sums = tile.sums[number_];
    const std::int64_t r = height_units(residual);
    sums[i].add(weight_of(error),
                r + height_units((column.top - column.first) * h_), sees(place, slope));
    ++column.rays;
    column.height += r;
    const Vec3 end = sensor_.pose.position + length * along;
    if (is_near(end)) {
      const Coord2 own = column_at(end);
      tile_of(own).columns[SurveyState::number_of(own)].cells.add(quarter_of(end, own),
                                                                   area_of(along, length));
    }
    return Meeting::kExpected;
  }

  /// Votes of columns whose soil lies above a ray short of its end.
  bool go_through(const Vec3& along, double length, double range_m, double sigma) {
    const double flat = along.head<2>().norm(), step = h_ / std::max(flat, 0.3);
    const double end = length - std::max(kThroughShortM, 3 * sigma);
    const double room = kThroughRoomM + 3.5 * sigma * std::abs(along.z());
    bool any = false;
    for (double t = std::max(0.0, range_m - kThroughBeforeM); t < end; t += step) {
      const Vec3 place = sensor_.pose.position + t * along;
      if (!is_near(place)) break;
      const Coord2 cell = column_at(place);
      SurveyTile& tile = tile_of(cell);
      const std::size_t i = SurveyState::number_of(cell);
      const double below = place.z() + room - height_m(tile.columns[i]);
      if (!(below < 0)) continue;
      ScanVotes& votes = tile.votes[static_cast<int>(i)];
      ++votes.through;
      votes.ceiling = std::min(votes.ceiling, height_units(below));
      any = true;
    }
    return any;
  }
  /// A vote for the height at which a ray ended.
  bool hit(const Vec3& point, const Vec3& along, double length, double sigma) {
    if (!is_near(point)) return false;
    const Coord2 cell = column_at(point);
    SurveyTile& tile = tile_of(cell);
    const std::size_t i = SurveyState::number_of(cell);
    const double height = point.z() - height_m(tile.columns[i]);
    if (!(std::abs(height) < kMostScanHeightM)) return false;
    const int bin = static_cast<int>(std::floor(height / kScanBinM));
    ScanHits& hits = tile.votes[static_cast<int>(i)].hits[bin][number_];
    ++hits.rays;
    hits.cells.add(quarter_of(point, cell), area_of(along, length));
    hits.height += height_units(height);
    hits.sums.add(weight_of(sigma * std::abs(along.z()) + kScanErrorM), 0, sees(point, {0, 0}));
    return true;
  }
  double height_m(const SurveyColumn& column) const {
    return state_.ground.origin().z() + h_ * column.top;
  }

  SurveyState& state_;
  const Sensor& sensor_;
  const int number_;
  const double h_;
  SurveyTile* last_ = nullptr;
};

}  // namespace

void SurveyState::add_rays(const Sensor& sensor, int number, std::span<const Vec3> points_m,
                                   std::span<const Pose* const> poses) {
  struct Body {
    Eigen::AlignedBox3d box;
    Pose bucket_from_world;
  };
  std::vector<Body> bodies;
  for (std::size_t m = 0; m < poses.size(); ++m)
    if (poses[m] != nullptr) bodies.push_back({body_of(buckets[m]), poses[m]->inverse()});
  std::vector<Vec3> ends, ways;
  for (const Vec3& point : points_m) {
    const bool masked = std::any_of(bodies.begin(), bodies.end(), [&](const Body& body) {
      return meets(body.box, body.bucket_from_world * sensor.pose.position,
                   body.bucket_from_world * point);
    });
    const Vec3 way = point - sensor.pose.position;
    if (masked) {
      ++rays.masked;
    } else if (way.squaredNorm() > 0) {
      ends.push_back(point);
      ways.push_back(way);
    }
  }
  std::vector<double> ranges(ways.size());
  map.cast(std::span(&sensor.pose.position, 1), ways, ranges);
  Rays all(*this, sensor, number);
  for (std::size_t i = 0; i < ends.size(); ++i) all.take(ends[i], ranges[i]);
}

}  // namespace soilvdb::inline v0
