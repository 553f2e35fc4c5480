// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "bench/engine.h"

#include <algorithm>

namespace soilvdb::bench {

const std::vector<Peer>& engines() {
  static const std::vector<Peer> all = {
      {"soilvdb", make_soilvdb, false},
      {"paper", make_paper, false},
      {"openvdb_stock", make_openvdb_stock},
      {"openvdb_csg", make_openvdb_csg},
#ifdef SOILVDB_WITH_OCTOMAP
      {"octomap", make_octomap},
#endif
#ifdef SOILVDB_WITH_CGAL
      {"cgal", make_cgal},
#endif
  };
  return all;
}

const Peer& engine(const std::string& name) {
  for (const Peer& peer : engines()) {
    if (peer.name == name) return peer;
  }
  std::string known;
  for (const Peer& peer : engines()) known += (known.empty() ? "" : ", ") + peer.name;
  throw std::invalid_argument("no engine '" + name + "'; built in are " + known);
}

std::vector<Vec3> mouth_outline(const Bucket& bucket, const Pose& world_from_bucket) {
  const double half = bucket.width_m / 2;
  return {world_from_bucket * Vec3(0, -half, 0), world_from_bucket * Vec3(0, half, 0),
          world_from_bucket * Vec3(0, half, bucket.height_m),
          world_from_bucket * Vec3(0, -half, bucket.height_m)};
}

StepSweep::StepSweep(const Bucket& bucket, const Pose& a, const Pose& b)
    : a_(a.inverse()), b_(b.inverse()), half_width_(bucket.width_m / 2), height_(bucket.height_m) {
  normal_a_ = a.rotation * Vec3::UnitX();
  normal_b_ = b.rotation * Vec3::UnitX();
  offset_a_ = normal_a_.dot(a.position);
  offset_b_ = normal_b_.dot(b.position);
  for (const Pose& pose : {a, b}) {
    for (const Vec3& corner : mouth_outline(bucket, pose)) box_.extend(corner);
  }
}

bool StepSweep::crosses_mouth(const Vec3& world, double fraction) const {
  const Vec3 p = a_ * world, q = b_ * world;
  const double y = p.y() + fraction * (q.y() - p.y()), z = p.z() + fraction * (q.z() - p.z());
  return std::abs(y) <= half_width_ && z >= 0 && z <= height_;
}

Eigen::AlignedBox3d soil_reach(const Task& task) {
  Eigen::AlignedBox3d box = task.reach;
  double top = box.min().z();
  constexpr int kPosts = 32;
  for (int i = 0; i <= kPosts; ++i) {
    for (int j = 0; j <= kPosts; ++j) {
      const Vec3 p = box.min() + (box.sizes().array() * Eigen::Array3d(i, j, 0) / kPosts).matrix();
      if (const auto z = task.terrain->height(p.x(), p.y())) top = std::max(top, *z);
    }
  }
  box.max().z() = std::min(box.max().z(), top);
  return box;
}

}  // namespace soilvdb::bench
