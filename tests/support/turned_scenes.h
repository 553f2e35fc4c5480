// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Random scenes of moving soil, played as they are and turned, mirrored or shifted: no direction
// and no place of the voxels is better than another.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "tests/support/tool_scenes.h"

namespace soilvdb::test {

inline Earthmoving random_soil(Random& random) {
  Earthmoving all = loam(random(0, 0.4));
  all.soil->repose_rad = random(0.45, 0.75);
  return all;
}

inline Bucket digger(double width_m) {
  Bucket bucket = digger();
  bucket.width_m = width_m;
  return bucket;
}

/// Two cycles; the second tips onto what the first tipped.
struct Cycles {
  double voxel_m = 0.1;
  Bucket bucket;
  Earthmoving all;
  Vec2 fall = Vec2::Zero();
  std::vector<Pose> path;
  std::size_t curled[2] = {0, 0};  // the poses at which it is full

  Cycles(Random& random, double voxel) : voxel_m(voxel) {
    const double width_m = random(0.6, 2), depth_m = random(0.2, 0.5), yaw = random(-0.4, 0.4);
    const Vec3 from{-3 + random(0, 0.1), random(-2, -1.9), 0};  // in this order
    bucket = digger(width_m);
    all = random_soil(random);
    fall = Vec2{random(-0.1, 0.1), random(-0.1, 0.1)};
    constexpr int kSteps = 60;
    const double aside_m = 4.5 + width_m / 2, apart_m = width_m + 0.4;
    for (const int n : {0, 1}) {
      const Vec3 begin = from + Vec3(0.3, -apart_m, 0) * n;
      curled[n] = path.size() + kSteps;
      for (const Pose& pose : cycle(begin, depth_m, kSteps, aside_m + apart_m * n))
        path.push_back(Turn{yaw}(pose));
      // Up, before it turns back.
      path.push_back({path.back().position + Vec3(0, 0, 1), path.back().rotation});
    }
    for (Pose& pose : path) pose.position.z() += fall.dot(pose.position.head<2>());
  }
};

/// What became of a scene.
struct Outcome {
  double voxel_m;
  int half;
  GroundWindow window;  // cells from -half to half about where the middle came to
  Vec2 fall;
  double loose_m3;
  std::vector<double> loads_m3;
  std::int64_t residual;

  const GroundColumn& at(const Coord2& cell) const {
    return window.at(cell.x() + half, cell.y() + half);
  }
  /// Cells above the ground as it was.
  double height(const Coord2& cell) const { return at(cell).top - fall.dot(cell.cast<double>()); }
  /// The same between columns, cells.
  double height(const Vec2& place) const {
    const Vec2 corner = place.array().floor(), in = place - corner;
    double sum = 0;
    for (const int x : {0, 1})
      for (const int y : {0, 1})
        sum += (x == 1 ? in.x() : 1 - in.x()) * (y == 1 ? in.y() : 1 - in.y()) *
               height(Coord2(corner.cast<int>() + Coord2(x, y)));
    return sum;
  }
  double highest() const {
    double most = 0;
    for (int x = -half; x <= half; ++x)
      for (int y = -half; y <= half; ++y) most = std::max(most, height(Coord2(x, y)));
    return most;
  }
};

/// @param shift of all of the scene, whole cells
inline Outcome outcome_of(const Cycles& cycles, const Turn& turn,
                          const Coord2& shift = Coord2::Zero()) {
  const Vec2 fall = turn(cycles.fall), shift_m = cycles.voxel_m * shift.cast<double>();
  ToolSite site(cycles.voxel_m, make_plane(-fall.dot(shift_m), fall), cycles.bucket, cycles.all);
  std::vector<double> loads_m3;
  for (std::size_t i = 0; i < cycles.path.size(); ++i) {
    Pose pose = turn(cycles.path[i]);
    pose.position.head<2>() += shift_m;
    site.tracker.update(0, pose);
    if (i == cycles.curled[0] || i == cycles.curled[1]) loads_m3.push_back(site.load_m3());
  }
  site.tracker.come_to_rest();
  const int half = static_cast<int>(std::ceil(10 / cycles.voxel_m)), side = 2 * half + 1;
  GroundWindow window(site.ground, shift - Coord2::Constant(half), side, side);
  return {cycles.voxel_m,  half,     std::move(window),     fall,
          site.loose_m3(), loads_m3, residual(site.tracker)};
}

/// How far the ground of a scene that was turned is from that of the one that wasn't.
struct Apart {
  double rms;   ///< cells, of columns that changed
  int columns;  ///< their number
};
inline Apart heights_apart(const Outcome& straight, const Outcome& turned, const Turn& turn) {
  double sum = 0;
  int columns = 0;
  const int most = straight.half - 1;
  for (int x = -most; x <= most; ++x) {
    for (int y = -most; y <= most; ++y) {
      const Vec2 there = turn(Vec2(x, y));
      if (there.cwiseAbs().maxCoeff() > most) continue;
      const double before = straight.height(Coord2(x, y)), after = turned.height(there);
      // Else the error of counts where nothing is done would make the rest small.
      if (std::max(std::abs(before), std::abs(after)) < 0.1) continue;
      sum += (after - before) * (after - before);
      ++columns;
    }
  }
  return {std::sqrt(sum / std::max(columns, 1)), columns};
}

}  // namespace soilvdb::test
