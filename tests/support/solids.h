// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground of known shape, sampled without a dig: flat or sloped, less boxes and half-sine trenches.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "soilvdb/ground.h"
#include "soilvdb/mesher.h"

namespace soilvdb::test {

/// A set of points: soil is where f < 0. Each feature is zero on one smooth piece of the surface
/// and about the distance from it nearby.
struct Solid {
  std::string name;
  double height_m = 0;
  Vec2 slope = Vec2::Zero();
  std::vector<std::function<double(const Vec3&)>> features;  ///< the ground first
  std::function<double(const Vec3&)> f;
  Eigen::AlignedBox3d hollow;  ///< beyond it there is only ground
};

struct Box {
  Pose world_from_box;
  Vec3 half;  ///< sides, m
};

Solid ground_less(std::string name, const Vec2& slope, const std::vector<Box>& boxes);
/// Half length 0.5 m, depth 0.25 m, width 0.6 m.
Solid half_sine_trench(double yaw_rad);
/// Two boxes with a wall between them. @param roll, yaw rad @param first_face_m of the wall, from
/// the lattice point at the origin
Solid thin_wall(double thickness_m, double roll, double yaw, double first_face_m);
/// A slot in the place of the wall.
Solid thin_slot(double thickness_m, double roll, double yaw, double first_face_m);

/// Trenches at three angles, boxes in a slope and along the axes, and an undercut.
const std::vector<Solid>& known_solids();

/// What is promised of the surface of such ground, voxels: 99 of 100 vertices, creases too; rms
/// where it is smooth.
inline constexpr double kVertexError = 0.15, kSmoothError = 0.02;

/// The ground before as base surface, and the samples of the solid wherever they differ.
std::unique_ptr<Ground> sampled(const Solid& solid, double voxel_size_m);

/// 27 chunks about the origin, voxels of 1 m, soil where f < 0: all of it is cut, for the base
/// surface is far above.
std::unique_ptr<Ground> sampled(const std::function<double(const Vec3&)>& f);

/// Volume between a mesh and the ground before, by the divergence theorem.
double below_ground_m3(const Mesh& mesh, const Solid& solid);

/// Distance from a point to the solid's surface, by the smallest ball with soil and air in it.
double distance_m(const Solid& solid, const Vec3& p, double step_m);

/// How many pieces of the surface are within so far.
int features_near(const Solid& solid, const Vec3& p, double distance_m);

/// Faults of a mesh as a surface.
struct Faults {
  int without_area = 0;  ///< triangles
  int crowded = 0;       ///< edges of more than two triangles
  int torn = 0;          ///< edges of one where the chunks around are resident
};
Faults faults(const Mesh& mesh, const Ground& ground);

}  // namespace soilvdb::test
