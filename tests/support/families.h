// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The named digs: bucket, exact continuous motion and ground, each in the dig's own frame.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/motion.h"
#include "tests/support/oracle.h"

namespace soilvdb::test {

/// Heights on a square grid about (0, 0), bilinear between posts.
struct Posts {
  int side = 0;
  double spacing_m = 0;
  std::vector<float> heights_m;  ///< row-major, low y first
};

/// A dig before it is placed. Time runs over [0, 1].
struct Family {
  std::string name;
  Bucket bucket;
  std::function<Pose(double)> pose;  ///< family_from_bucket at a time
  std::vector<double> kinks;         ///< times where the velocity jumps
  std::function<Motion(const Pose& world_from_family)> motion;
  double height_m = 0;  ///< ground: a plane, unless there are posts
  Vec2 slope = Vec2::Zero();
  std::optional<Posts> posts;
  bool planar = false;             ///< moves in the x-z plane, mouth along y
  Vec3 direction = Vec3::UnitX();  ///< of the oracle's lines
  std::optional<double> closed_form_m3;

  Sweep sweep() const { return {{mouth(bucket)}, pose, kinks}; }
};

/// All of them, in a fixed order.
const std::vector<Family>& all_families();
/// Drag, curl and swing mixed, over a sloped plane.
Family random_family(std::uint64_t seed);

}  // namespace soilvdb::test
