// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What each ray of a scan says: of the column that it was to meet, or that the ground is another.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/survey/scan_state.h"

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

/// A box turned against the world, with room about it, as rays from a place end in it.
struct Body {
  Body(const Eigen::AlignedBox3d& tight, const Pose& pose, const Vec3& place) {
    const Vec3 room = Vec3::Constant(kMaskRoomM);
    const Eigen::AlignedBox3d box(tight.min() - room, tight.max() + room);
    const Vec3 from = pose.inverse() * place;
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
};

/// Marks rays that end in a body.
SOILVDB_FOR_CPUS void mark_masked(const Body& body, const float* x, const float* y, const float* z,
                                  const float* length, std::size_t count, std::uint8_t* masked) {
  for (std::size_t i = 0; i < count; ++i) {
    float inside = std::numeric_limits<float>::infinity();  // by how much
    for (std::size_t a = 0; a < 3; ++a) {
      const std::array<float, 3>& row = body.rows[a];
      const float end = length[i] * (row[0] * x[i] + row[1] * y[i] + row[2] * z[i]);
      inside = std::min(inside, std::min(end - body.low[a], body.high[a] - end));
    }
    masked[i] |= inside >= 0 ? 1 : 0;
  }
}

/// A part of a machine. Rays that end behind it passed it: it was not quite where it was said to
/// be, or its boxes hold more than it fills. What they tell of the ground there is true.
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
    // As a rule few rays end near, and there are many boxes.
    std::array<std::uint8_t, kRaysAtOnce> marks = {};
    mark_masked(all_, &rays.x[first], &rays.y[first], &rays.z[first], &rays.length_m[first], count,
                marks.data());
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
      mark_masked(box, few_.x.data(), few_.y.data(), few_.z.data(), few_.length_m.data(), number,
                  marks.data());
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

/// Tiles about a sensor that are found without a look-up, columns.
constexpr int kReach = 512, kTilesAbout = 2 * kReach / kChunkSide + 1;

/// Columns about a sensor. Places are from it, m.
struct ColumnsAbout {
  std::array<float, 2> at = {};  // the sensor from their corner, columns
  float cells = 0;               // 1 / m
};

/// The columns that places are in, from that of the corner.
struct Places {
  std::array<std::int32_t, kRaysAtOnce> x, y;
  std::array<std::int32_t, kRaysAtOnce> tile;             // about the sensor; -1: farther away
  std::array<std::int32_t, kRaysAtOnce> column, quarter;  // in the tile, and in that: 4 x + y
};

/// @param along how far on each ray, m
SOILVDB_FOR_CPUS void find_places(const ColumnsAbout& columns, const float* x, const float* y,
                                  const float* along, std::size_t count, Places& out) {
  constexpr float kMost = 1 << 24;
  constexpr int kMask = kChunkSide - 1;
  for (std::size_t i = 0; i < count; ++i) {
    const float far_u = columns.at[0] + along[i] * x[i] * columns.cells;
    const float far_v = columns.at[1] + along[i] * y[i] * columns.cells;
    const float u = far_u > -kMost ? std::min(far_u, kMost) : -kMost;  // also of what is no number
    const float v = far_v > -kMost ? std::min(far_v, kMost) : -kMost;
    const float low_u = std::floor(u), low_v = std::floor(v);
    const auto cx = static_cast<std::int32_t>(low_u), cy = static_cast<std::int32_t>(low_v);
    const std::int32_t tx = cx >> 3, ty = cy >> 3;
    const bool is_near = tx >= 0 && ty >= 0 && tx < kTilesAbout && ty < kTilesAbout;
    out.x[i] = cx;
    out.y[i] = cy;
    out.tile[i] = is_near ? tx * kTilesAbout + ty : -1;
    out.column[i] = (cx & kMask) * kChunkSide + (cy & kMask);
    out.quarter[i] =
        4 * static_cast<std::int32_t>(4 * (u - low_u)) + static_cast<std::int32_t>(4 * (v - low_v));
  }
}

/// What rays at a time say of the columns that they were to meet.
struct Meetings {
  template <typename T>
  using Values = std::array<T, kRaysAtOnce>;

  Values<float> slope_x, slope_y;  // of the ground that they were to meet
  Values<std::int32_t> is_met;     // as of Meeting
  Values<float> sigma;             // of their lengths, m
  Values<float> x, y, z;           // where they were to meet it, z by the slope, m
  Values<float> doubt;             // of their residuals squared, what their noise does not explain
  Values<std::int64_t> weight, residual, lever_x, lever_y, lever_z;  // as ScanSums has them
  Values<std::int64_t> area;  // in plan, that they stand for on level ground
};
enum Meeting : std::int32_t { kMissed, kTooFlat, kMet };

/// As std::lrint(), but for many at once, of less than 2^51.
inline std::int64_t rounded(double value) {
  constexpr double kUnits = 0x1.8p52;  // to which a double of this size is rounded
  return static_cast<std::int64_t>(std::bit_cast<std::uint64_t>(value + kUnits) -
                                   std::bit_cast<std::uint64_t>(kUnits));
}

/// How far a ray ends from where it was to meet the ground, and what it weighs.
/// @param gate_m besides three sigmas of its noise
SOILVDB_FOR_CPUS void measure(const RangeNoise& noise, float gate_m, const float* xs,
                              const float* ys, const float* zs, const float* lengths,
                              const float* ranges, std::size_t count, Meetings& out) {
  const auto sigma_m = static_cast<float>(noise.sigma_m);
  const auto squared_per_m = static_cast<float>(noise.squared_per_m);
  std::array<float, kRaysAtOnce> residuals, errors, areas;
  for (std::size_t i = 0; i < count; ++i) {
    const float length = lengths[i], range = ranges[i], z = zs[i];
    const float x = range * xs[i], y = range * ys[i];
    const float a = out.slope_x[i], b = out.slope_y[i];
    const float sigma = sigma_m + squared_per_m * length * length;
    const float descent = z - (a * xs[i] + b * ys[i]), off = length - range;
    constexpr auto kWall = static_cast<float>(kScanWallSlope * kScanWallSlope);
    const bool is_flat = (descent > -static_cast<float>(kLeastDescent)) | (a * a + b * b >= kWall);
    const float residual = off * descent;
    const float error = sigma * std::abs(descent) + static_cast<float>(kScanErrorM);
    const bool is_about = std::abs(off) < 3 * sigma + static_cast<float>(kWallGateM);
    const bool is_near = std::abs(residual) < 3 * error + gate_m;
    const std::int32_t flat = is_about ? kTooFlat : kMissed, other = is_near ? kMet : kMissed;
    out.is_met[i] = is_flat ? flat : other;
    out.sigma[i] = sigma;
    out.x[i] = x;
    out.y[i] = y;
    out.z[i] = range * descent;
    out.doubt[i] = residual * residual - 9 * error * error;
    residuals[i] = residual;
    errors[i] = 1 / (error * error);
    areas[i] = static_cast<float>(kScanArea) * length * length /
               std::max(std::abs(z), static_cast<float>(kLeastDescent));
  }
  for (std::size_t i = 0; i < count; ++i) {
    const double residual = residuals[i];
    out.residual[i] =
        rounded(std::min(std::max(residual, -kMostScanHeightM), kMostScanHeightM) * kScanUnitsPerM);
  }
  for (std::size_t i = 0; i < count; ++i)
    out.weight[i] = rounded(std::max(1.0, static_cast<double>(errors[i])));
  for (std::size_t i = 0; i < count; ++i) out.area[i] = rounded(static_cast<double>(areas[i]));
  for (std::size_t i = 0; i < count; ++i) {
    out.lever_x[i] = rounded(static_cast<double>(out.x[i]) * kScanLeversPerM);
    out.lever_y[i] = rounded(static_cast<double>(out.y[i]) * kScanLeversPerM);
    out.lever_z[i] = rounded(static_cast<double>(out.z[i]) * kScanLeversPerM);
  }
}

/// Takes the rays of a scan. Coordinates are from the sensor, m.
class Rays {
 public:
  Rays(ScanState& state, const Sensor& sensor, int number)
      : state_(state),
        from_(sensor.pose.position),
        model_(range_model(sensor)),
        number_(number),
        h_(static_cast<float>(state.voxel_m())),
        mount_{static_cast<float>(height_sigma_m(sensor) * height_sigma_m(sensor)),
               static_cast<float>(tilt_sigma_rad(sensor) * tilt_sigma_rad(sensor)),
               static_cast<float>(sensor.mount_scale_sigma * sensor.mount_scale_sigma)} {
    const Vec3 at = state.ground.index_from_world(from_);
    is_near_ = at.head<2>().cwiseAbs().maxCoeff() < 2 * kMaxIndex;
    if (!is_near_) return;
    first_ =
        floor_to(Coord2(cell_of(at.x()), cell_of(at.y())), kChunkSide) - Coord2::Constant(kReach);
    columns_.cells = 1 / h_;
    for (int a = 0; a < 2; ++a)
      columns_.at[static_cast<std::size_t>(a)] = static_cast<float>(at[a] - first_[a] + 0.5);
    level_ = state.ground.origin().z() - from_.z();
  }

  /// @param ranges to the ground as it is expected, m
  void take(const ScanRays& rays, std::span<const float> ranges) {
    const float gate = std::max(static_cast<float>(kScanGateM), h_);
    for (std::size_t begin = 0; begin < rays.count(); begin += kRaysAtOnce) {
      const std::size_t count = std::min(kRaysAtOnce, rays.count() - begin);
      const float *const x = &rays.x[begin], *const y = &rays.y[begin], *const z = &rays.z[begin];
      const float *const length = &rays.length_m[begin], *const range = &ranges[begin];
      find_places(columns_, x, y, range, count, met_);
      find_places(columns_, x, y, length, count, ends_);
      find_grounds(range, count);
      measure(model_.noise, gate, x, y, z, length, range, count, meetings_);
      for (std::size_t i = 0; i < count; ++i) take({i, x[i], y[i], z[i], length[i]}, range[i]);
    }
  }

 private:
  struct Ray {
    std::size_t number;     // in met_ and ends_
    float x, y, z, length;  // direction; m
  };
  struct Slot {
    ScanTile* tile = nullptr;
    std::array<ScanSums, BaseColumn::kCells>* sums = nullptr;
  };
  /// A column that a place is in.
  struct Place {
    Slot* slot = nullptr;
    std::size_t i = 0, quarter = 0;
    const ScanColumn& column() const { return slot->tile->columns[i]; }
    ColumnRays& rays() const { return slot->tile->rays[i]; }
  };

  void take(const Ray& ray, float range) {
    const float sigma = meetings_.sigma[ray.number];
    RayCounts& rays = state_.rays;
    if (range == 0 || !is_near_) {  // the sensor is below the ground
      ++rays.dropped;
      return;
    }
    if (std::isfinite(range)) {
      if (meet(ray)) {
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

  /// @return whether it is near enough
  bool find(const Places& places, std::size_t number, Place& place) {
    place.i = static_cast<std::size_t>(places.column[number]);
    place.quarter = static_cast<std::size_t>(places.quarter[number]);
    const int near = places.tile[number];
    const Coord2 in(places.x[number], places.y[number]);
    if (near >= 0) {
      place.slot = &near_[static_cast<std::size_t>(near)];
    } else {
      if (!((first_ + in).cwiseAbs().maxCoeff() < static_cast<int>(kMaxIndex))) return false;
      place.slot = &far_[plan_key(floor_to(in, kChunkSide))];
    }
    if (place.slot->tile == nullptr) {
      const Coord2 cell = first_ + floor_to(in, kChunkSide);
      if (!(cell.cwiseAbs().maxCoeff() < static_cast<int>(kMaxIndex))) return false;
      place.slot->tile = &state_.tile(cell);
      state_.news.insert(ScanState::mark(cell));
    }
    return true;
  }
  /// How a height that a ray measures errs with its sensor's mount. @param arm from the sensor, m
  static std::array<std::int64_t, 4> sees(float x, float y, float along) {
    return {kScanHeightLever, levers(x), levers(y), levers(along)};
  }
  static constexpr std::int64_t kScanHeightLever = 1000;
  static_assert(kScanLever_m == 1e-3);
  /// Of a height from the sensor above a column's first.
  double above(const ScanColumn& column, float z) const {
    return static_cast<double>(z) - (level_ + static_cast<double>(h_) * column.first);
  }

  /// Columns are many and stand far apart: those of rays to come are on their way meanwhile.
  /// @return the tile of a place, if it is known and near; else null
  ScanTile* coming(const Places& places, std::size_t number) const {
    const int near = places.tile[number];
    return near < 0 ? nullptr : near_[static_cast<std::size_t>(near)].tile;
  }
  void fetch_ground(std::size_t number) const {
    const ScanTile* const tile = coming(met_, number);
    if (tile == nullptr) return;
    const auto i = static_cast<std::size_t>(met_.column[number]);
    __builtin_prefetch(&tile->columns[i].top);
    __builtin_prefetch(&tile->rays[i].met, 1);
  }
  void fetch_end(std::size_t number) const {
    const ScanTile* const tile = coming(ends_, number);
    if (tile == nullptr) return;
    const auto i = static_cast<std::size_t>(ends_.column[number]);
    const ColumnRays& rays = tile->rays[i];
    __builtin_prefetch(&tile->columns[i].first);
    __builtin_prefetch(&rays.cells.areas[static_cast<std::size_t>(ends_.quarter[number])], 1);
    __builtin_prefetch(&rays.height, 1);
  }

  /// The columns that rays were to meet, and their slopes.
  void find_grounds(const float* ranges, std::size_t count) {
    constexpr std::size_t kAhead = 24;
    for (std::size_t i = 0; i < std::min(count, kAhead); ++i) fetch_ground(i);
    for (std::size_t i = 0; i < count; ++i) {
      if (i + kAhead < count) fetch_ground(i + kAhead);
      find_ground(i, ranges[i]);
    }
  }
  void find_ground(std::size_t number, float range) {
    Place& met = grounds_[number];
    met.slot = nullptr;
    meetings_.slope_x[number] = meetings_.slope_y[number] = 0;
    if (!is_near_ || range == 0 || !std::isfinite(range)) return;
    if (!find(met_, number, met) || std::isnan(met.column().top)) {
      met.slot = nullptr;
      return;
    }
    if (met.slot->sums != nullptr) __builtin_prefetch(&(*met.slot->sums)[met.i], 1);
    fetch_end(number);
    const Vec2& slope = met.slot->tile->slopes[met.i];
    meetings_.slope_x[number] = static_cast<float>(slope.x());
    meetings_.slope_y[number] = static_cast<float>(slope.y());
  }

  /// Did a ray end about where it was to meet the ground? Tells the column there.
  bool meet(const Ray& ray) {
    const std::size_t n = ray.number;
    const Meetings& m = meetings_;
    const Place& met = grounds_[n];
    if (met.slot == nullptr || m.is_met[n] == kMissed) return false;
    Place end;
    if (m.is_met[n] == kTooFlat) {
      if (find(ends_, n, end)) ++end.rays().blind;
      return true;
    }
    const float x = m.x[n], y = m.y[n], z = m.z[n], doubt = m.doubt[n];
    if (doubt >= 0 &&
        doubt >= 9 * (static_cast<float>(state_.expected_variance(*met.slot->tile, met.i)) +
                      mount_[0] + mount_[1] * (x * x + y * y) + mount_[2] * z * z))
      return false;
    const ScanColumn& column = met.column();
    std::int64_t r = m.residual[n];
    if (column.top != column.first)
      r += height_units((column.top - column.first) * state_.voxel_m());
    if (met.slot->sums == nullptr) met.slot->sums = &met.slot->tile->sums[number_];
    (*met.slot->sums)[met.i].add(m.weight[n], r,
                                 {kScanHeightLever, m.lever_x[n], m.lever_y[n], m.lever_z[n]});
    ++met.rays().met;
    if (find(ends_, n, end)) {
      const ScanColumn& in = end.column();
      ColumnRays& rays = end.rays();
      rays.cells.add(end.quarter, m.area[n]);
      if (!std::isnan(in.first)) rays.height += height_units(above(in, ray.length * ray.z));
    }
    return true;
  }

  /// A vote for the height at which a ray ended.
  bool hit(const Ray& ray, float sigma) {
    Place end;
    if (!find(ends_, ray.number, end)) return false;
    const float x = ray.length * ray.x, y = ray.length * ray.y, z = ray.length * ray.z;
    const double height = above(end.column(), z);
    if (!(std::abs(height) < kMostScanHeightM)) return false;
    const int bin = static_cast<int>(std::floor(height / kScanBinM));
    ScanHits& hits = end.slot->tile->votes[static_cast<int>(end.i)].hits[bin][number_];
    ++hits.rays;
    hits.cells.add(end.quarter, meetings_.area[ray.number]);
    hits.height += height_units(height);
    hits.sums.add(ray_weight(sigma * std::abs(ray.z) + static_cast<float>(kScanErrorM)), 0,
                  sees(x, y, z));
    return true;
  }

  ScanState& state_;
  const Vec3 from_;
  const RangeModel model_;
  const int number_;
  const float h_;
  const std::array<float, 3> mount_;  // variances of its height, its tilts, its scale
  bool is_near_ = false;
  Coord2 first_ = {0, 0};  // column from which columns are counted
  ColumnsAbout columns_;   // from there
  double level_ = 0;       // of index space, from the sensor, m
  Places met_, ends_;      // of rays at a time: where they were to meet the ground, and ended
  std::array<Place, kRaysAtOnce> grounds_;  // columns that they were to meet, if there is ground
  Meetings meetings_;
  std::vector<Slot> near_ = std::vector<Slot>(std::size_t{kTilesAbout} * kTilesAbout);
  std::unordered_map<std::uint64_t, Slot, PlanHash> far_;
};

}  // namespace

ScanRays ScanState::unmasked(const Sensor& sensor, std::span<const Vec3> points_m,
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
    Eigen::AlignedBox3f around;
    for (const Vec3& point :
         points_m.subspan(begin, std::min(kRaysAtOnce, points_m.size() - begin))) {
      const Vec3 way = point - from;
      const double length = way.norm();
      if (length < std::numeric_limits<float>::min()) continue;  // it has no direction
      all.set_way(count, (1 / length) * way);
      all.length_m[count++] = static_cast<float>(length);
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

void ScanState::add_rays(const Sensor& sensor, int number, const ScanRays& ends) {
  std::vector<float> ranges(ends.count());
  view.ranges(sensor.pose.position, ends, ranges);
  is_solved = is_solved && ends.count() == 0;
  Rays(*this, sensor, number).take(ends, ranges);
}

}  // namespace soilvdb::inline v0
