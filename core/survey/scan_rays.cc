// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What each ray of a scan says: of the column that it was to meet, or that the ground is another.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/survey/survey_state.h"

namespace soilvdb::inline v0 {
namespace {

/// Ends of rays in plan, at so many at a time, meet the same bodies.
constexpr std::size_t kRaysAtOnce = 256;

/// The body of a bucket, in its frame.
Eigen::AlignedBox3d body_of(const Bucket& bucket) {
  Eigen::AlignedBox3d box;
  for (const Vec3& point : extremes(bucket)) box.extend(point);
  if (bucket.profile.empty() && !bucket.shape) box.extend(Vec3(-bucket.height_m, 0, 0));
  return box;
}

/// A box turned against the world, with room about it, as rays from a place meet it.
struct Body {
  Body(const Eigen::AlignedBox3d& tight, const Pose& pose, const Vec3& place) {
    const Vec3 room = Vec3::Constant(kMaskRoomM);
    const Eigen::AlignedBox3d box(tight.min() - room, tight.max() + room);
    const Vec3 from = pose.inverse() * place;
    has_place = box.contains(from);
    const Eigen::Matrix3d turn = pose.rotation.toRotationMatrix().transpose();
    for (int a = 0; a < 3; ++a) {
      const auto n = static_cast<std::size_t>(a);
      low[n] = static_cast<float>(box.min()[a] - from[a]);
      high[n] = static_cast<float>(box.max()[a] - from[a]);
      for (int k = 0; k < 3; ++k)
        rows[n][static_cast<std::size_t>(k)] = static_cast<float>(turn(a, k));
    }
    for (int corner = 0; corner < 8; ++corner)
      around.extend(
          (pose * box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(corner)) - place)
              .cast<float>()
              .eval());
  }

  std::array<float, 3> low, high;  // of the box from the place, in its frame, m
  std::array<std::array<float, 3>, 3> rows;
  Eigen::AlignedBox3f around;  // from the place, axes of the world
  bool has_place;              // in the box: all rays begin there
};

/// Marks rays that meet a body before their ends.
/// @param begins share of its length at which a ray begins
SOILVDB_FOR_CPUS void mark_masked(const Body& body, float begins, const float* x, const float* y,
                                  const float* z, const float* length, std::size_t count,
                                  std::uint8_t* masked) {
  for (std::size_t i = 0; i < count; ++i) {
    float begin = begins * length[i], end = length[i];
    for (std::size_t a = 0; a < 3; ++a) {
      const std::array<float, 3>& row = body.rows[a];
      const float along = row[0] * x[i] + row[1] * y[i] + row[2] * z[i];
      const float rate = 1 / (std::abs(along) < 1e-12f ? 1e-12f : along);
      const float s = body.low[a] * rate, t = body.high[a] * rate;
      begin = std::max(begin, std::min(s, t));
      end = std::min(end, std::max(s, t));
    }
    masked[i] |= begin <= end ? 1 : 0;
  }
}

/// A part of a machine. A sensor may stand in one of its boxes, as on a cab's roof: of its rays
/// those meet that box that end in it.
class Mask {
 public:
  Mask(const PlacedBoxes& part, const Vec3& place)
      : all_(around(part), part.world_from_boxes, place) {
    for (const Eigen::AlignedBox3d& box : part.boxes_m)
      boxes_.emplace_back(box, part.world_from_boxes, place);
    few_.resize(kRaysAtOnce);
  }

  /// Marks those of rays from `first` on, kRaysAtOnce at most. @param ends about their ends
  void mark(const ScanRays& rays, std::size_t first, std::size_t count,
            const Eigen::AlignedBox3f& ends, std::uint8_t* masked) {
    if (!ends.intersects(all_.around)) return;
    // As a rule few rays come near, and there are many boxes.
    std::array<std::uint8_t, kRaysAtOnce> marks = {};
    mark_masked(all_, 0, &rays.x[first], &rays.y[first], &rays.z[first], &rays.length_m[first],
                count, marks.data());
    std::array<std::size_t, kRaysAtOnce> near;
    std::size_t number = 0;
    for (std::size_t i = 0; i < count; ++i) {
      if (marks[i] == 0) continue;
      few_.x[number] = rays.x[first + i];
      few_.y[number] = rays.y[first + i];
      few_.z[number] = rays.z[first + i];
      few_.length_m[number] = rays.length_m[first + i];
      near[number++] = i;
    }
    marks = {};
    for (const Body& box : boxes_)
      mark_masked(box, box.has_place ? 1 : 0, few_.x.data(), few_.y.data(), few_.z.data(),
                  few_.length_m.data(), number, marks.data());
    for (std::size_t i = 0; i < number; ++i) masked[near[i]] |= marks[i];
  }

 private:
  static Eigen::AlignedBox3d around(const PlacedBoxes& part) {
    Eigen::AlignedBox3d all;
    for (const Eigen::AlignedBox3d& box : part.boxes_m) all.extend(box);
    return all;
  }

  Body all_;
  std::vector<Body> boxes_;
  ScanRays few_;
};

std::int64_t in_units(float value, double unit) {
  return std::lrint(static_cast<double>(value) / unit);
}

/// Of a residual or a height; what is farther is no residual.
std::int64_t height_units(double height_m) {
  return std::lrint(std::clamp(height_m, -kMostScanHeightM, kMostScanHeightM) / kScanUnit_m);
}
std::int64_t weight_of(float sigma_m) {
  return std::max<std::int64_t>(1, std::lrint(1 / (sigma_m * sigma_m)));
}

/// Takes the rays of a scan. Coordinates are from the sensor, m; cells from its own column.
class Rays {
 public:
  Rays(SurveyState& state, const Sensor& sensor, int number)
      : state_(state),
        from_(sensor.pose.position),
        constant_(static_cast<float>(sensor.range_sigma_m)),
        squared_(static_cast<float>(sensor.range_squared_sigma_per_m)),
        number_(number),
        h_(static_cast<float>(state.voxel_m())),
        cells_(1 / h_),
        mount_{static_cast<float>(sensor.mount_height_sigma_m * sensor.mount_height_sigma_m),
               static_cast<float>(sensor.mount_tilt_sigma_rad * sensor.mount_tilt_sigma_rad),
               static_cast<float>(sensor.mount_scale_sigma * sensor.mount_scale_sigma)} {
    const Vec3 at = state.ground.index_from_world(from_);
    is_near_ = at.head<2>().cwiseAbs().maxCoeff() < 2 * kMaxIndex;
    if (!is_near_) return;
    first_ =
        floor_to(Coord2(cell_of(at.x()), cell_of(at.y())), kChunkSide) - Coord2::Constant(kReach);
    for (int a = 0; a < 2; ++a)
      at_[static_cast<std::size_t>(a)] = static_cast<float>(at[a] - first_[a] + 0.5);
    level_ = state.ground.origin().z() - from_.z();
  }

  struct Ray {
    float x, y, z, length;  // direction; m
  };

  /// @param range to the ground as it is expected, m
  void take(const Ray& ray, float range) {
    const float sigma = constant_ + squared_ * ray.length * ray.length;
    RayCounts& rays = state_.rays;
    if (range == 0 || !is_near_) {  // the sensor is below the ground
      ++rays.dropped;
      return;
    }
    if (std::isfinite(range)) {
      if (meet(ray, range, sigma)) {
        ++rays.used;
        return;
      }
      if (ray.length - range > static_cast<float>(kMostThroughM)) {  // a mirror, such as water
        ++rays.dropped;
        return;
      }
      // Else it ended before the way that is looked at comes to the ground.
      if (ray.length - range > std::max(static_cast<float>(kThroughShortM), 3 * sigma))
        state_.through.push_back({from_, from_ + double(ray.length) * Vec3(ray.x, ray.y, ray.z),
                                  range, sigma, state_.time});
    }
    if (!hit(ray, sigma)) ++rays.dropped;
  }

 private:
  /// Tiles about the sensor that are found without a look-up, columns.
  static constexpr int kReach = 512, kTiles = 2 * kReach / kChunkSide + 1;
  struct Slot {
    SurveyTile* tile = nullptr;
    std::array<ScanSums, BaseColumn::kCells>* sums = nullptr;
  };
  /// A column that a place is in.
  struct Place {
    Slot* slot;
    std::size_t i, quarter;
    SurveyColumn& column() const { return slot->tile->columns[i]; }
  };

  /// @param x, y from the sensor, m @return whether it is near enough
  bool find(float x, float y, Place& place) {
    const float u = at_[0] + x * cells_, v = at_[1] + y * cells_;
    const float low_u = std::floor(u), low_v = std::floor(v);
    const auto cx = static_cast<int>(low_u), cy = static_cast<int>(low_v);
    constexpr int kMask = kChunkSide - 1;
    place.i = static_cast<std::size_t>((cx & kMask) * kChunkSide + (cy & kMask));
    place.quarter = static_cast<std::size_t>(4 * static_cast<int>(4 * (u - low_u)) +
                                             static_cast<int>(4 * (v - low_v)));
    const int tx = cx >> 3, ty = cy >> 3;
    if (tx >= 0 && ty >= 0 && tx < kTiles && ty < kTiles) {
      place.slot = &near_[static_cast<std::size_t>(tx * kTiles + ty)];
    } else {
      const Coord2 cell = first_ + Coord2(cx, cy);
      if (!(cell.cwiseAbs().maxCoeff() < static_cast<int>(kMaxIndex))) return false;
      place.slot = &far_[plan_key({tx, ty})];
    }
    if (place.slot->tile == nullptr) {
      const Coord2 cell = first_ + kChunkSide * Coord2(tx, ty);
      if (!(cell.cwiseAbs().maxCoeff() < static_cast<int>(kMaxIndex))) return false;
      place.slot->tile = &state_.tile(cell);
      state_.news.insert(SurveyState::mark(cell));
    }
    return true;
  }
  /// How a height that a ray measures errs with its sensor's mount. @param arm from the sensor, m
  static std::array<std::int64_t, 4> sees(float x, float y, float along) {
    return {1000, in_units(x, kScanLever_m), in_units(y, kScanLever_m),
            in_units(along, kScanLever_m)};
  }
  static_assert(kScanLever_m == 1e-3);
  /// Area in plan that a ray stands for, on level ground.
  static std::int64_t area_of(const Ray& ray) {
    return std::lrint(static_cast<float>(kScanArea) * ray.length * ray.length /
                      std::max(std::abs(ray.z), static_cast<float>(kLeastDescent)));
  }
  /// Of a height from the sensor above a column's first.
  double above(const SurveyColumn& column, float z) const {
    return static_cast<double>(z) - (level_ + static_cast<double>(h_) * column.first);
  }

  /// Did a ray end about where it was to meet the ground? Tells the column there.
  bool meet(const Ray& ray, float range, float sigma) {
    Place met;
    const float x = range * ray.x, y = range * ray.y;
    if (!find(x, y, met)) return false;
    SurveyColumn& column = met.column();
    if (std::isnan(column.top)) return false;
    const Vec2& slope = met.slot->tile->slopes[met.i];
    const auto a = static_cast<float>(slope.x()), b = static_cast<float>(slope.y());
    const float descent = ray.z - (a * ray.x + b * ray.y), off = ray.length - range;
    constexpr auto kWall = static_cast<float>(kScanWallSlope * kScanWallSlope);
    Place end;
    if (descent > -static_cast<float>(kLeastDescent) || a * a + b * b >= kWall) {
      if (!(std::abs(off) < 3 * sigma + static_cast<float>(kWallGateM))) return false;
      if (find(ray.length * ray.x, ray.length * ray.y, end)) ++end.column().blind;
      return true;
    }
    const float residual = off * descent, z = range * descent;
    const float error = sigma * std::abs(descent) + static_cast<float>(kScanErrorM);
    if (std::abs(residual) >= 3 * error + std::max(static_cast<float>(kScanGateM), h_) ||
        residual * residual >=
            9 * (error * error +
                 static_cast<float>(state_.expected_variance(*met.slot->tile, met.i)) + mount_[0] +
                 mount_[1] * (x * x + y * y) + mount_[2] * z * z))
      return false;
    std::int64_t r = in_units(residual, kScanUnit_m);
    if (column.top != column.first)
      r += height_units((column.top - column.first) * state_.voxel_m());
    if (met.slot->sums == nullptr) met.slot->sums = &met.slot->tile->sums[number_];
    (*met.slot->sums)[met.i].add(weight_of(error), r, sees(x, y, z));
    ++column.rays;
    if (find(ray.length * ray.x, ray.length * ray.y, end)) {
      SurveyColumn& own = end.column();
      own.cells.add(end.quarter, area_of(ray));
      if (!std::isnan(own.first)) own.height += height_units(above(own, ray.length * ray.z));
    }
    return true;
  }

  /// A vote for the height at which a ray ended.
  bool hit(const Ray& ray, float sigma) {
    Place end;
    const float x = ray.length * ray.x, y = ray.length * ray.y, z = ray.length * ray.z;
    if (!find(x, y, end)) return false;
    const double height = above(end.column(), z);
    if (!(std::abs(height) < kMostScanHeightM)) return false;
    const int bin = static_cast<int>(std::floor(height / kScanBinM));
    ScanHits& hits = end.slot->tile->votes[static_cast<int>(end.i)].hits[bin][number_];
    ++hits.rays;
    hits.cells.add(end.quarter, area_of(ray));
    hits.height += height_units(height);
    hits.sums.add(weight_of(sigma * std::abs(ray.z) + static_cast<float>(kScanErrorM)), 0,
                  sees(x, y, z));
    return true;
  }

  SurveyState& state_;
  const Vec3 from_;
  const float constant_, squared_;  // of a ray's sigma
  const int number_;
  const float h_, cells_;
  const std::array<float, 3> mount_;  // variances of its height, its tilts, its scale
  bool is_near_ = false;
  Coord2 first_ = {0, 0};         // column from which columns are counted
  std::array<float, 2> at_ = {};  // the sensor from its corner
  double level_ = 0;              // of index space, from the sensor, m
  std::vector<Slot> near_ = std::vector<Slot>(std::size_t{kTiles} * kTiles);
  std::unordered_map<std::uint64_t, Slot, PlanHash> far_;
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

ScanRays SurveyState::unmasked(const Sensor& sensor, std::span<const Vec3> points_m,
                               std::span<const Pose* const> poses,
                               std::span<const PlacedBoxes> links) {
  const Vec3& from = sensor.pose.position;
  std::vector<Mask> masks;
  for (std::size_t m = 0; m < poses.size(); ++m) {
    if (poses[m] == nullptr) continue;
    const Eigen::AlignedBox3d body = body_of(buckets[m]);
    masks.emplace_back(PlacedBoxes{*poses[m], std::span(&body, 1)}, from);
  }
  for (const PlacedBoxes& link : links) masks.emplace_back(link, from);
  ScanRays all;
  all.resize(points_m.size());
  std::size_t count = 0;
  std::array<std::uint8_t, kRaysAtOnce> masked;
  for (std::size_t begin = 0; begin < points_m.size(); begin += kRaysAtOnce) {
    const std::size_t first = count;
    Eigen::AlignedBox3f around(Eigen::Vector3f::Zero());
    for (const Vec3& point :
         points_m.subspan(begin, std::min(kRaysAtOnce, points_m.size() - begin))) {
      const Vec3 way = point - from;
      const double length = way.norm();
      if (length == 0) continue;
      const Vec3 along = way / length;
      all.x[count] = static_cast<float>(along.x());
      all.y[count] = static_cast<float>(along.y());
      all.z[count] = static_cast<float>(along.z());
      all.length_m[count] = static_cast<float>(length);
      ++count;
      around.extend(way.cast<float>());
    }
    if (masks.empty()) continue;
    masked.fill(0);
    for (Mask& mask : masks) mask.mark(all, first, count - first, around, masked.data());
    const std::size_t end = count;
    count = first;
    for (std::size_t i = first; i < end; ++i)
      if (masked[i - first] == 0) all.copy(i, count++);
    rays.masked += static_cast<std::int64_t>(end - count);
  }
  all.resize(count);
  return all;
}

void SurveyState::add_rays(const Sensor& sensor, int number, const ScanRays& ends) {
  std::vector<float> ranges(ends.count());
  view.ranges(sensor.pose.position, ends, ranges);
  is_solved = is_solved && ends.count() == 0;
  Rays all(*this, sensor, number);
  for (std::size_t i = 0; i < ends.count(); ++i)
    all.take({ends.x[i], ends.y[i], ends.z[i], ends.length_m[i]}, ranges[i]);
}

}  // namespace soilvdb::inline v0
