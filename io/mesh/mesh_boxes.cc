// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/mesh/mesh_boxes.h"

#include <numeric>

namespace soilvdb::inline v0::io {
namespace {

/// A part of a triangle: a convex polygon.
using Part = std::vector<Vec3>;
using Boxes = std::vector<Eigen::AlignedBox3d>;

/// At most 2^8 boxes of a mesh.
constexpr int kMostHalvings = 8;
/// Two boxes are better than one about both if they have less than this share of its volume.
constexpr double kWorthHalving = 0.9;

/// With half of the room on each side, because the rooms of two boxes overlap.
double volume_with(const Eigen::AlignedBox3d& box, double room_m) {
  return (box.sizes().array() + room_m).prod();
}

/// What of a part is on one side of a plane across an axis. @param side 1: above, -1: below
Part cut(const Part& part, int axis, double at, int side) {
  Part kept;
  for (std::size_t i = 0; i < part.size(); ++i) {
    const Vec3 &a = part[i], &b = part[(i + 1) % part.size()];
    const double from = side * (a[axis] - at), to = side * (b[axis] - at);
    if (from >= 0) kept.push_back(a);
    if ((from < 0) == (to < 0) || from == 0) continue;
    Vec3 between = a + (b - a) * (from / (from - to));
    between[axis] = at;
    kept.push_back(between);
  }
  return kept;
}

Boxes boxes_of(const std::vector<Part>& parts, double room_m, int halvings) {
  Eigen::AlignedBox3d all;
  for (const Part& part : parts)
    for (const Vec3& point : part) all.extend(point);
  int axis = 0;
  if (halvings == kMostHalvings || all.sizes().maxCoeff(&axis) <= 2 * room_m) return {all};
  Boxes halves;
  for (const int side : {-1, 1}) {
    std::vector<Part> some;
    for (const Part& part : parts)
      if (Part kept = cut(part, axis, all.center()[axis], side); !kept.empty())
        some.push_back(std::move(kept));
    const Boxes half = boxes_of(some, room_m, halvings + 1);
    halves.insert(halves.end(), half.begin(), half.end());
  }
  const double volume =
      std::accumulate(halves.begin(), halves.end(), 0.0,
                      [&](double sum, const auto& box) { return sum + volume_with(box, room_m); });
  if (volume > kWorthHalving * volume_with(all, room_m)) return {all};
  return halves;
}

}  // namespace

std::vector<Eigen::AlignedBox3d> boxes_about(const std::vector<std::array<Vec3, 3>>& triangles,
                                             double room_m) {
  if (triangles.empty()) return {};
  std::vector<Part> parts;
  for (const auto& triangle : triangles) parts.emplace_back(triangle.begin(), triangle.end());
  return boxes_of(parts, room_m, 0);
}

}  // namespace soilvdb::inline v0::io
