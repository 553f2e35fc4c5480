// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Bounds of a bucket, and its check. Each message begins with the name of a field.
#include "soilvdb/bucket.h"

#include <stdexcept>
#include <string>
#include <utility>

#include "core/constants.h"
#include "core/lattice/text.h"
#include "core/tool/polygon.h"
#include "soilvdb/tool_shape.h"

namespace soilvdb::inline v0 {
namespace {

[[noreturn]] void refuse(const std::string& message) { throw std::invalid_argument(message); }

std::string plane_point_text(const Vec2& p) { return "[" + text(p.x()) + ", " + text(p.y()) + "]"; }

void check_side(const std::string& name, double side_m) {
  if (side_m >= kMinBucketSideM && side_m <= kMaxBucketSideM) return;
  refuse(name + " is " + text(side_m) + " m; it must be from " + text(kMinBucketSideM) + " to " +
         text(kMaxBucketSideM) + " m");
}

bool on_segment(const Vec2& p, const Vec2& a, const Vec2& b) {
  return (p - a).dot(p - b) <= 0;  // p is known to be on the line
}

/// Do the closed segments ab and cd share a point?
bool meet(const Vec2& a, const Vec2& b, const Vec2& c, const Vec2& d) {
  const double abc = cross2(b - a, c - a), abd = cross2(b - a, d - a);
  const double cda = cross2(d - c, a - c), cdb = cross2(d - c, b - c);
  if (((abc > 0 && abd < 0) || (abc < 0 && abd > 0)) &&
      ((cda > 0 && cdb < 0) || (cda < 0 && cdb > 0))) {
    return true;
  }
  return (abc == 0 && on_segment(c, a, b)) || (abd == 0 && on_segment(d, a, b)) ||
         (cda == 0 && on_segment(a, c, d)) || (cdb == 0 && on_segment(b, c, d));
}

void check_profile(const std::vector<Vec2>& profile, double height_m) {
  const std::size_t n = profile.size();
  const Vec2 lip(0, 0), upper_edge(0, height_m);
  if (n < 3) {
    refuse("profile has " + std::to_string(n) + (n == 1 ? " point" : " points") +
           "; it needs at least 3, from the lip " + plane_point_text(lip) + " to the upper edge " +
           plane_point_text(upper_edge));
  }
  if (n > kMaxProfilePoints) {
    refuse("profile has " + std::to_string(n) + " points; it may have at most " +
           std::to_string(kMaxProfilePoints));
  }
  for (const Vec2& p : profile) {
    if (!(p.cwiseAbs().maxCoeff() <= kMaxBucketSideM)) {
      refuse("profile has the point " + plane_point_text(p) + "; coordinates must be within " +
             text(kMaxBucketSideM) + " m");
    }
    if (p.x() > 0) {
      refuse("profile has the point " + plane_point_text(p) +
             " in front of the mouth; x must be 0 or less");
    }
  }
  if ((profile.front() - lip).norm() > kSamePointM) {
    refuse("profile starts at " + plane_point_text(profile.front()) +
           "; it must start at the lip, " + plane_point_text(lip));
  }
  if ((profile.back() - upper_edge).norm() > kSamePointM) {
    refuse("profile ends at " + plane_point_text(profile.back()) +
           "; it must end at the upper edge, " + plane_point_text(upper_edge));
  }
  // Edge i runs from point i to point i + 1; edge n - 1 is the mouth.
  const auto point = [&](std::size_t i) -> const Vec2& { return profile[i % n]; };
  for (std::size_t i = 0; i < n; ++i) {
    const Vec2 &a = point(i), &b = point(i + 1), &c = point(i + 2);
    if ((b - a).norm() <= kSamePointM) {
      refuse("profile has the point " + plane_point_text(a) + " twice in a row; leave one out");
    }
    if (cross2(b - a, c - b) == 0 && (b - a).dot(c - b) < 0) {
      refuse("profile turns back on itself at " + plane_point_text(b) +
             "; it must enclose an area with the mouth");
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 2; j < n; ++j) {
      if (i == 0 && j == n - 1) continue;  // neighbours across the lip
      if (meet(point(i), point(i + 1), point(j), point(j + 1))) {
        refuse("profile crosses itself between the edges that start at " +
               plane_point_text(point(i)) + " and " + plane_point_text(point(j)) +
               "; it and the mouth must be a simple polygon");
      }
    }
  }
}

}  // namespace

std::vector<Vec3> extremes(const Bucket& bucket) {
  std::vector<Vec3> points;
  if (bucket.shape) {
    for (int k = 0; k < 8; ++k)
      points.push_back(
          bucket.shape->box_m().corner(static_cast<Eigen::AlignedBox3d::CornerType>(k)));
    return points;
  }
  for (const double y : {-bucket.width_m / 2, bucket.width_m / 2}) {
    points.emplace_back(0, y, 0);
    points.emplace_back(0, y, bucket.height_m);
    for (const Vec2& p : bucket.profile) points.emplace_back(p.x(), y, p.y());
  }
  return points;
}

void Bucket::validate() const {
  check_side("width", width_m);
  check_side("height", height_m);
  if (shape && (!profile.empty() || dump_angle_rad))
    refuse("shape is there, so the tool holds nothing; leave out profile and dump_angle");
  if (!profile.empty()) check_profile(profile, height_m);
  for (const auto& [name, thickness_m] : {std::pair("edge", edge_m), std::pair("plate", plate_m)})
    if (!(thickness_m >= 0 && thickness_m <= height_m))
      refuse(std::string(name) + " is " + text(thickness_m) +
             " m; it must be a thickness from 0 to the bucket's height");
  if (plate_m > 0 && profile.empty())
    refuse("plate is there without a profile, so no side plate is known; give the profile");
  if (dump_angle_rad && !(*dump_angle_rad >= 0 && *dump_angle_rad <= 1.5708)) {
    refuse("dump_angle is " + text(*dump_angle_rad) +
           " rad; it must be from 0 to 1.5708 (the mouth looks straight down)");
  }
}

}  // namespace soilvdb::inline v0
