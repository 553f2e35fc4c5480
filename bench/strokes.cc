// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "bench/strokes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "core/surface/surface.h"
#include "tests/support/oracle.h"

namespace soilvdb::bench {

Health health(const Ground& ground, const Tracker& tracker) {
  Health h;
  const float band = static_cast<float>(ground.band_m());
  const Ground untouched(
      ground.voxel_size_m(), ground.origin(),
      std::shared_ptr<const InitialTerrain>(&ground.terrain(), [](const InitialTerrain*) {}));
  SampleWords before, now;
  float phi_m[kChunkVoxels];
  for (const Chunk* chunk : ground.chunks()) {
    untouched.read_samples(chunk->origin, before);
    ground.read_samples(chunk->origin, now);
    surface_distance(ground, chunk->origin, phi_m);
    for (std::size_t i = 0; i < kChunkVoxels; ++i) {
      h.not_finite += !std::isfinite(phi_m[i]) || std::abs(phi_m[i]) > band;
      h.grown += (now[i] & ~before[i]) != 0;
    }
    ++h.chunks;
  }
  h.residual_m3 = ground.change_m3() + tracker.total().cut_m3();
  h.memory_bytes = static_cast<double>(ground.memory_bytes());
  return h;
}

Bucket small_bucket(double scale) {
  Bucket bucket;
  bucket.width_m = 0.6 * scale;
  bucket.height_m = 0.4 * scale;
  return bucket;
}

Vec3 Drag::origin() const {
  const double step = 100 * scale;
  return (offset / step).array().round().matrix() * step;
}

std::unique_ptr<InitialTerrain> Drag::terrain() const {
  const double slope = std::tan(slope_rad);
  return make_plane(offset.z() - slope * offset.x(), {slope, 0});
}

Pose Drag::pose(double s) const {
  const Eigen::Quaterniond tilt(Eigen::AngleAxisd(-slope_rad, Vec3::UnitY()));
  Pose pose;
  pose.rotation = tilt * from_rpy(0, 0, yaw_rad);
  pose.position = offset + pose.rotation * (scale * Vec3(s - 0.5, 0, -depth_m));
  return pose;
}

double Drag::cut_m3() const {
  Ground ground(voxel_m, origin(), terrain());
  Tracker tracker(ground, {small_bucket(scale)});
  for (int i = 0; i <= updates; ++i) tracker.update(0, pose(static_cast<double>(i) / updates));
  return tracker.total().cut_m3();
}

double Random::next() {
  std::uint64_t v = state_ += 0x9e3779b97f4a7c15u;
  v = (v ^ (v >> 30)) * 0xbf58476d1ce4e5b9u;
  v = (v ^ (v >> 27)) * 0x94d049bb133111ebu;
  return static_cast<double>((v ^ (v >> 31)) >> 11) * 0x1p-53;
}

Pose RandomStrokes::next(double sunk_m) {
  const auto wander = [this](double& v, double low, double high) {
    v += random_.between(-0.1, 0.1);
    v = std::clamp(v < low ? 2 * low - v : v > high ? 2 * high - v : v, low, high);
  };
  wander(position_.x(), -1, 1);
  wander(position_.y(), -1, 1);
  wander(position_.z(), -0.5 - sunk_m, 0.2 - sunk_m);
  wander(roll_rad_, -0.5, 0.5);
  wander(pitch_rad_, -1.2, 1.2);
  wander(yaw_rad_, -1e9, 1e9);
  return {position_, from_rpy(roll_rad_, pitch_rad_, yaw_rad_)};
}

Count count_swept(const Bucket& bucket, const std::vector<Pose>& path,
                  const InitialTerrain& terrain, double box_m) {
  struct Stroke {
    test::Sweep sweep;
    Eigen::AlignedBox3d box;
  };
  std::vector<Stroke> strokes;
  Eigen::AlignedBox3d all;
  for (std::size_t i = 1; i < path.size(); ++i) {
    const auto pose = [a = path[i - 1], b = path[i]](double t) { return interpolate(a, b, t); };
    Stroke stroke{{{test::mouth(bucket)}, pose, {}}, {}};
    constexpr int kPoses = 32;
    for (int k = 0; k <= kPoses; ++k) {
      for (const Vec3& corner : mouth_corners(bucket)) {
        stroke.box.extend(pose(static_cast<double>(k) / kPoses) * corner);
      }
    }
    const Vec3 bulge = 0.01 * stroke.box.sizes();  // between those poses
    stroke.box = {stroke.box.min() - bulge, stroke.box.max() + bulge};
    all.extend(stroke.box);
    strokes.push_back(std::move(stroke));
  }
  const auto swept = [&](const Vec3& p) {
    const auto z = terrain.height(p.x(), p.y());
    if (!z || p.z() >= *z) return false;
    return std::any_of(strokes.begin(), strokes.end(), [&p](const Stroke& s) {
      return s.box.contains(p) && test::passes_through(s.sweep, p);
    });
  };
  const Coord3 sides = (all.sizes() / box_m).array().ceil().matrix().cast<int>();
  std::vector<int> hits(static_cast<std::size_t>(sides.prod()));  // 0, 1 or 2
  tbb::parallel_for(std::size_t{0}, hits.size(), [&](std::size_t i) {
    Random random(i);
    const int n = static_cast<int>(i);
    const Vec3 first = all.min() + box_m * Vec3(n % sides.x(), n / sides.x() % sides.y(),
                                                n / sides.x() / sides.y());
    for (int k = 0; k < 2; ++k) {
      hits[i] += swept(first + box_m * Vec3(random.next(), random.next(), random.next()));
    }
  });
  // Both points in or out in all boxes but those on the border: these tell the variance.
  const double sum = std::accumulate(hits.begin(), hits.end(), 0.0) / 2;
  const auto split = static_cast<double>(std::count(hits.begin(), hits.end(), 1));
  const double box_m3 = box_m * box_m * box_m;
  return {box_m3 * sum, box_m3 * std::sqrt(split) / 2};
}

}  // namespace soilvdb::bench
