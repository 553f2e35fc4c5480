// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Surfaces made from samples against ground of known shape. With the environment variable
// SOILVDB_TABLE set, prints every figure.
#include "core/surface/surface.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/surface_height.h"
#include "tests/support/dig_runner.h"
#include "tests/support/sanitized.h"
#include "tests/support/solids.h"

namespace soilvdb::test {
namespace surface_test {

constexpr double kDegree = std::numbers::pi / 180;
/// What is required of the mesh at a voxel size.
struct Required {
  double voxel_size_m;
  double volume;  ///< against the samples, relative
};
constexpr std::array<Required, 3> kRequired{{{0.1, 5e-3}, {0.05, 1e-3}, {0.025, 3e-4}}};
/// A vertex is on a smooth part if no other piece of the surface is within this, voxels.
constexpr double kSmoothRadius = 1.5;
/// The finest voxels there are, m.
constexpr double kFinest = test::kSanitized ? 0.05 : 0.025;
constexpr double kPlaneNormal = 0.5 * kDegree, kFloorNormal = 1.5 * kDegree;

struct Figures {
  double volume = 0, p99 = 0, smooth = 0;
};

Figures measure(const Solid& solid, double h) {
  const auto ground = sampled(solid, h);
  const Mesh mesh = mesh_all(*ground);
  Figures figures;
  figures.volume = below_ground_m3(mesh, solid) / -ground->change_m3() - 1;
  std::vector<double> errors;
  double squares = 0;
  int smooth = 0;
  for (const Eigen::Vector3f& point : mesh.points) {
    const Vec3 p = point.cast<double>();
    const int near = features_near(solid, p, kSmoothRadius * h);
    if (near == 1 && std::abs(solid.features[0](p)) < kSmoothRadius * h) continue;  // untouched
    errors.push_back(distance_m(solid, p, 0.005 * h) / h);
    if (near > 1) continue;
    squares += errors.back() * errors.back();
    ++smooth;
  }
  std::sort(errors.begin(), errors.end());
  figures.p99 = errors[errors.size() * 99 / 100];
  if (smooth > 0) figures.smooth = std::sqrt(squares / smooth);
  if (std::getenv("SOILVDB_TABLE") != nullptr) {
    fmt::print("{:32}{:7} m  volume {:+.3f} %  p99 {:.3f}  smooth rms {:.4f} voxel\n", solid.name,
               h, 100 * figures.volume, figures.p99, figures.smooth);
  }
  return figures;
}

TEST(SurfaceMeshOfSamples, HoldsTheirVolumeAndLiesOnTheTrueSurface) {
  for (const Solid& solid : known_solids()) {
    for (const auto& [h, volume] : kRequired) {
      if (h < kFinest) continue;
      const Figures figures = measure(solid, h);
      EXPECT_LE(std::abs(figures.volume), volume) << solid.name << ", voxel " << h;
      if (h > 0.05) continue;
      EXPECT_LE(figures.p99, kVertexError) << solid.name << ", voxel " << h;
      EXPECT_LE(figures.smooth, kSmoothError) << solid.name << ", voxel " << h;
    }
  }
}

struct NormalErrors {
  double faces = 0;   ///< of the triangles themselves
  double shaded = 0;  ///< of the vertices' normals, half-way between them in each triangle
};

/// Root mean squares over the floor's area, for a sliver of a triangle shows as little as it
/// covers: against the true normal below the middle of each triangle whose vertices have no crease
/// near.
NormalErrors floor_normals(const Solid& trench, double h) {
  const auto& floor = trench.features[1];
  const auto truth = [&](const Vec3& p) -> Vec3 {
    constexpr double kStep = 1e-6;
    Vec3 gradient;
    for (int a = 0; a < 3; ++a) {
      gradient[a] = floor(p + kStep * Vec3::Unit(a)) - floor(p - kStep * Vec3::Unit(a));
    }
    return gradient.normalized();
  };
  const Mesh mesh = mesh_all(*sampled(trench, h));
  const auto point = [&](std::uint32_t k) -> Vec3 { return mesh.points[k].cast<double>(); };
  const auto facing = [&](const auto& t) -> Vec3 {  // twice the area long
    return (point(t[1]) - point(t[0])).cross(point(t[2]) - point(t[0]));
  };
  std::vector<Vec3> at_vertex(mesh.points.size(), Vec3::Zero());
  for (const auto& t : mesh.triangles) {
    for (const std::uint32_t k : t) at_vertex[k] += facing(t);
  }
  double area = 0, faces = 0, shaded = 0;
  for (const auto& t : mesh.triangles) {
    const bool smooth = std::all_of(t.begin(), t.end(), [&](std::uint32_t k) {
      return std::abs(floor(point(k))) < kSmoothRadius * h &&
             features_near(trench, point(k), kSmoothRadius * h) == 1;
    });
    if (!smooth) continue;
    const Vec3 n = truth((point(t[0]) + point(t[1]) + point(t[2])) / 3);
    Vec3 between = Vec3::Zero();
    for (const std::uint32_t k : t) between += at_vertex[k].normalized();
    const auto square = [&](const Vec3& v) {
      return std::pow(std::acos(std::min(v.normalized().dot(n), 1.0)), 2);
    };
    const double weight = facing(t).norm();
    area += weight;
    faces += weight * square(facing(t));
    shaded += weight * square(between);
  }
  const NormalErrors errors{std::sqrt(faces / area), std::sqrt(shaded / area)};
  if (std::getenv("SOILVDB_TABLE") != nullptr) {
    fmt::print("{:32}{:7} m  normals of the floor: faces {:.2f}  shaded {:.2f} degrees\n",
               trench.name, h, errors.faces / kDegree, errors.shaded / kDegree);
  }
  return errors;
}

TEST(SurfaceMeshOfSamples, FindsTheNormalsOfACurvedFloor) {
  for (const Solid& solid : known_solids()) {
    if (!solid.name.starts_with("half-sine")) continue;
    for (const double h : {0.05, kFinest}) {
      const NormalErrors errors = floor_normals(solid, h);
      EXPECT_LE(errors.shaded, kFloorNormal) << solid.name << ", voxel " << h;
      // At 5 cm the ends bend with a radius of 2.5 voxels, and two triangles of a voxel can't.
      if (h < 0.05) {
        EXPECT_LE(errors.faces, kFloorNormal) << solid.name << ", voxel " << h;
      }
    }
  }
}

TEST(SurfaceMeshOfSamples, FindsAPlaneOfAnyDirection) {
  constexpr int kDirections = 200;
  double position = 0, normal = 0, distance = 0;
  int points = 0, triangles = 0;
  for (int i = 0; i < kDirections; ++i) {
    const double z = 1 - 2 * (i + 0.5) / kDirections, r = std::sqrt(1 - z * z), a = 2.399963 * i;
    const Vec3 n(r * std::cos(a), r * std::sin(a), z);
    const auto plane = sampled([&](const Vec3& p) { return n.dot(p - Vec3::Constant(3.3)); });
    const Ground& ground = *plane;
    const Coord3 middle(0, 0, 0);
    float phi[kChunkVoxels];
    surface_distance(ground, middle, phi);
    for (int k = 0; k < kChunkVoxels; ++k) {
      const double truth = n.dot(numbered_voxel(k).cast<double>() - Vec3::Constant(3.3));
      distance = std::max(distance, std::abs(phi[k] - std::clamp(truth, -3.0, 3.0)));
    }
    const SurfaceBlock surface(ground, {&middle, 1}, SurfaceBlock::kMesh);
    const auto at = [&](std::uint32_t k) -> Vec3 {
      const ContourVertex& v = surface.contour().vertices[k];
      return (surface.first() + v.cell).cast<double>() + Vec3(v.in[0], v.in[1], v.in[2]);
    };
    for (const auto& t : surface.contour().triangles) {
      const Vec3 facing = (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).normalized();
      normal += std::pow(std::acos(std::min(facing.dot(n), 1.0)), 2);
      ++triangles;
      for (const std::uint32_t k : t) {
        position += std::pow(n.dot(at(k) - Vec3::Constant(3.3)), 2);
        ++points;
      }
    }
  }
  ASSERT_GT(triangles, 50 * kDirections);
  EXPECT_LE(std::sqrt(position / points), kSmoothError);
  EXPECT_LE(distance, 3 * kSmoothError);
  EXPECT_LE(std::sqrt(normal / triangles), kPlaneNormal);
}

TEST(SurfaceMeshOfSamples, StaysInABoreOfVoxelsThatShareAnEdge) {
  Ground ground(1, Vec3::Zero(), make_plane(100, {0, 0}));
  SampleWords bore{};
  for (std::size_t k = 1; k < 7; ++k) bore[k * 64 + k * 8 + 4] = kAllSoil;
  GroundWriter(ground).remove(Coord3::Zero(), bore);
  const Mesh mesh = mesh_all(ground);
  for (const Eigen::Vector3f& p : mesh.points) {
    EXPECT_LE(std::abs(p.z() - 4), 0.5 + kVertexError) << p.transpose();
    EXPECT_LE(std::abs(p.x() - p.y()), 1 + kVertexError) << p.transpose();
  }
  const Faults f = faults(mesh, ground);
  EXPECT_EQ(f.without_area, 0);
  EXPECT_EQ(f.crowded, 0);
  EXPECT_EQ(f.torn, 0);
}

/// @param least_m3 of volume, from which on it isn't kept
void keeps(const Solid& solid, double h, double least_m3, const std::string& what) {
  const auto ground = sampled(solid, h);
  const Mesh mesh = mesh_all(*ground);
  const Faults f = faults(mesh, *ground);
  EXPECT_EQ(f.torn, 0) << what;
  EXPECT_EQ(f.crowded, 0) << what;
  EXPECT_LE(std::abs(below_ground_m3(mesh, solid) + ground->change_m3()), least_m3) << what;
}

TEST(SurfaceMeshOfSamples, KeepsAWallAndASlotOneVoxelThick) {
  for (const double h : test::kLong ? std::vector{0.05, kFinest} : std::vector{0.05}) {
    const double thin_m3 = 0.8 * 0.3 * h;
    for (const auto& [roll, yaw] : {std::pair{0.0, 0.0}, {0.0, 0.5}, {0.2, 0.3}, {0.0, 0.785}}) {
      // With faces on centres of voxels and between cells, too.
      for (const double offset : {0.0, 0.154, 0.5, 0.75}) {
        const std::string what =
            fmt::format("roll {}, yaw {}, offset {}, voxel {}", roll, yaw, offset, h);
        const Solid wall = thin_wall(h, roll, yaw, offset * h);
        keeps(wall, h, thin_m3 / 20, "wall, " + what);
        EXPECT_LE(measure(wall, h).p99, kVertexError) << "wall, " << what;
        // Nearly all of a slot is creases, of which neither cell shows both planes.
        keeps(thin_slot(h, roll, yaw, offset * h), h, thin_m3 / 5, "slot, " + what);
      }
    }
  }
}

/// Also where triangles meet.
TEST(SurfaceHeight, AtVerticesIsThatBesideThem) {
  for (const Solid& solid : known_solids()) {
    const auto ground = sampled(solid, 0.1);
    SurfaceHeight heights(*ground);
    std::int64_t alone = 0, looked = 0;
    for (const Eigen::Vector3f& point : mesh_all(*ground).points) {
      const Vec2 at = ground->origin().head<2>() + point.head<2>().cast<double>();
      constexpr double kBeside = 1e-7;
      double low = 1e9, high = -1e9;
      for (const Vec2& beside : {Vec2(1, 2), Vec2(-2, 1), Vec2(-1, -2), Vec2(2, -1)}) {
        const Vec2 near = at + kBeside * beside;
        const double z = heights.at(near.x(), near.y()).value_or(-1e9);
        low = std::min(low, z);
        high = std::max(high, z);
      }
      const double z = heights.at(at.x(), at.y()).value_or(-1e9);
      alone += z < low - 1e-3 || z > high + 1e-3;
      ++looked;
    }
    EXPECT_EQ(alone, 0) << solid.name << ", of " << looked;
  }
}

}  // namespace surface_test
}  // namespace soilvdb::test
