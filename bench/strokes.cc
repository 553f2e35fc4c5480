// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "bench/strokes.h"

#include <cmath>
#include <vector>

namespace soilvdb::bench {

Health health(const Soil& soil, const Tracker& tracker) {
  Health h;
  const float band = static_cast<float>(soil.band_m());
  const Soil untouched(soil.voxel_size_m(), soil.origin(),
                       std::shared_ptr<const BaseSurface>(&soil.base(), [](const BaseSurface*) {}));
  SampleWords before, now;
  float phi_m[kLeafSize];
  for (const Chunk* chunk : soil.chunks()) {
    untouched.read_samples(chunk->origin, before);
    soil.read_samples(chunk->origin, now);
    soil.read_phi(chunk->origin, phi_m);
    for (std::size_t i = 0; i < kLeafSize; ++i) {
      h.not_finite += !std::isfinite(phi_m[i]) || std::abs(phi_m[i]) > band;
      h.grown += (now[i] & ~before[i]) != 0;
    }
    ++h.chunks;
  }
  h.residual_m3 = soil.change_m3() + tracker.total().cut_m3();
  h.memory_bytes = static_cast<double>(soil.memory_bytes());
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

std::unique_ptr<BaseSurface> Drag::ground() const {
  const double slope = std::tan(slope_rad);
  return make_plane(offset.z() - slope * offset.x(), {slope, 0});
}

Pose Drag::pose(double s) const {
  const Eigen::Quaterniond tilt(Eigen::AngleAxisd(-slope_rad, Vec3::UnitY()));
  Pose pose;
  pose.rotation = tilt * from_rpy(0, 0, yaw_rad);
  pose.position = offset + pose.rotation * (scale * Vec3(s - 0.5, 0, -0.2));
  return pose;
}

double Drag::cut_m3() const {
  Soil soil(voxel_m, origin(), ground());
  Tracker tracker(soil, {small_bucket(scale)});
  for (int i = 0; i <= updates; ++i) tracker.update(0, pose(static_cast<double>(i) / updates));
  return tracker.total().cut_m3();
}

double Random::next() {
  std::uint64_t v = state_ += 0x9e3779b97f4a7c15u;
  v = (v ^ (v >> 30)) * 0xbf58476d1ce4e5b9u;
  v = (v ^ (v >> 27)) * 0x94d049bb133111ebu;
  return static_cast<double>((v ^ (v >> 31)) >> 11) * 0x1p-53;
}

Pose random_pose(Random& random) {
  Pose pose;
  pose.position = {random.between(-1, 1), random.between(-1, 1), random.between(-0.5, 0.2)};
  pose.rotation = from_rpy(random.between(-0.5, 0.5), random.between(-1.2, 1.2),
                           random.between(-3.14159, 3.14159));
  return pose;
}

}  // namespace soilvdb::bench
