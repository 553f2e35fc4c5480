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
#include <random>

#include "core/ground/soil_writer.h"
#include "soilvdb/surface_height.h"
#include "tests/dig_runner.h"
#include "tests/sanitized.h"
#include "tests/solids.h"

namespace soilvdb::testing {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// What is required of the mesh at a voxel size.
struct Required {
  double voxel_size_m;
  double volume;  ///< against the samples, relative
};
constexpr std::array<Required, 3> kRequired{{{0.1, 5e-3}, {0.05, 1e-3}, {0.025, 3e-4}}};
/// Of the true surface, voxels: 99 of 100 vertices, creases too; rms where it is smooth.
constexpr double kVertexError = 0.15, kSmoothError = 0.02;
/// A vertex is on a smooth part if no other piece of the surface is within this, voxels.
constexpr double kSmoothRadius = 1.5;
/// The finest voxels there are, m.
constexpr double kFinest = test::kSanitized ? 0.05 : 0.025;
constexpr double kPlaneNormal = 0.5 * kDegree, kFloorNormal = 1.5 * kDegree;

const std::vector<Solid>& solids() {
  static const std::vector<Solid> all = [] {
    const auto at = [](double x, double y, double z, double roll, double pitch, double yaw) {
      return Pose{Vec3(x, y, z), from_rpy(roll, pitch, yaw)};
    };
    std::vector<Solid> list;
    for (const double yaw : {0.0, 33.0, 61.0}) {
      list.push_back(half_sine_trench(yaw * kDegree));
      list.back().name += fmt::format(" at {:.0f} degrees", yaw);
    }
    list.push_back(ground_less("box in a slope", {0.2, 0.1},
                               {{at(0.013, 0.008, 0.009, 0.1, 0.15, 0.5), {0.5, 0.3, 0.3}}}));
    list.push_back(ground_less("box along the axes", {0, 0},
                               {{at(0.013, 0.008, 0.009, 0, 0, 0), {0.5, 0.3, 0.3}}}));
    list.push_back(ground_less("undercut", {0, 0},
                               {{at(0.013, 0.008, 0.009, 0, 0, 0.3), {0.4, 0.3, 0.3}},
                                {at(0.5, 0.1, -0.2, 0, 0, 0.3), {0.4, 0.2, 0.1}}}));
    return list;
  }();
  return all;
}

struct Figures {
  double volume = 0, p99 = 0, smooth = 0;
};

Figures measure(const Solid& solid, double h) {
  const auto soil = sampled(solid, h);
  const Mesh mesh = mesh_all(*soil);
  Figures figures;
  figures.volume = below_ground_m3(mesh, solid) / -soil->change_m3() - 1;
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
  for (const Solid& solid : solids()) {
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
  for (const Solid& solid : solids()) {
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
    const Soil& soil = *plane;
    const Coord3 middle(0, 0, 0);
    float phi[kChunkVoxels];
    surface_distance(soil, middle, phi);
    for (int k = 0; k < kChunkVoxels; ++k) {
      const double truth = n.dot(Vec3(k >> 6, k >> 3 & 7, k & 7) - Vec3::Constant(3.3));
      distance = std::max(distance, std::abs(phi[k] - std::clamp(truth, -3.0, 3.0)));
    }
    const SurfaceBlock surface(soil, {&middle, 1}, SurfaceBlock::kMesh);
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
  Soil soil(1, Vec3::Zero(), make_plane(100, {0, 0}));
  SampleWords bore{};
  for (std::size_t k = 1; k < 7; ++k) bore[k * 64 + k * 8 + 4] = kAllSoil;
  SoilWriter(soil).remove(Coord3::Zero(), bore);
  const Mesh mesh = mesh_all(soil);
  for (const Eigen::Vector3f& p : mesh.points) {
    EXPECT_LE(std::abs(p.z() - 4), 0.5 + kVertexError) << p.transpose();
    EXPECT_LE(std::abs(p.x() - p.y()), 1 + kVertexError) << p.transpose();
  }
  const Faults f = faults(mesh, soil);
  EXPECT_EQ(f.without_area, 0);
  EXPECT_EQ(f.crowded, 0);
  EXPECT_EQ(f.torn, 0);
}

/// @param least_m3 of volume, from which on it isn't kept
void keeps(const Solid& solid, double h, double least_m3, const std::string& what) {
  const auto soil = sampled(solid, h);
  const Mesh mesh = mesh_all(*soil);
  const Faults f = faults(mesh, *soil);
  EXPECT_EQ(f.torn, 0) << what;
  EXPECT_EQ(f.crowded, 0) << what;
  EXPECT_LE(std::abs(below_ground_m3(mesh, solid) + soil->change_m3()), least_m3) << what;
}

TEST(SurfaceMeshOfSamples, KeepsAWallAndASlotOneVoxelThick) {
  for (const double h : {0.05, kFinest}) {
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

Dig random_or_named(int k) {
  const auto& names = families();
  const int named = static_cast<int>(names.size());
  return k < named ? make_dig(names[static_cast<std::size_t>(k)], placements()[1])
                   : random_dig(static_cast<std::uint64_t>(k - named + 1));
}

TEST(SurfaceMeshOfADig, IsManifoldAndWatertight) {
  const int digs = static_cast<int>(families().size()) + 10;
  for (int k = 0; k < digs; ++k) {
    const Dig dig = random_or_named(k);
    for (const double h : {0.1, 0.05}) {
      const Dug dug(dig, h, 50);
      const Faults f = faults(mesh_all(dug.soil), dug.soil);
      EXPECT_EQ(f.without_area, 0) << dig.family << ", voxel " << h;
      EXPECT_EQ(f.crowded, 0) << dig.family << ", voxel " << h;
      EXPECT_EQ(f.torn, 0) << dig.family << ", voxel " << h;
    }
  }
}

TEST(SurfaceMeshOfADig, IsManifoldWhereTheSurfaceRunsThroughTheGrid) {
  Soil soil(0.05, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(soil, {Bucket{1.0, 0.6, {}, {}}});
  tracker.update(0, Pose{Vec3(0, 0, 0), from_rpy(0, -0.4, 0)});
  tracker.update(0, Pose{Vec3(0.5, 0, -0.4), from_rpy(0, -0.3, 0)});
  const Faults f = faults(mesh_all(soil), soil);
  EXPECT_EQ(f.without_area, 0);
  EXPECT_EQ(f.crowded, 0);
  EXPECT_EQ(f.torn, 0);
}

TEST(SurfaceMeshOfADig, PatchesAreTheSameWhateverElseIsMeshed) {
  const Dug dug(make_dig("overlapping", placements()[1]), 0.05, 50);
  int compared = 0;
  for (const Chunk* chunk : dug.soil.chunks()) {
    const Coord3& origin = chunk->origin;
    const Coord3 block(origin.x() & ~31, origin.y() & ~31, origin.z() & ~31);
    const std::vector<Coord3> all = resident_chunks(dug.soil, block);
    const SurfaceBlock whole(dug.soil, all, SurfaceBlock::kMesh);
    const SurfaceBlock part(dug.soil, {&origin, 1}, SurfaceBlock::kMesh);
    std::map<std::array<float, 3>, int> places;
    const auto key = [](const SurfaceBlock& b, const ContourVertex& v) {
      const Coord3 c = b.first() + v.cell;
      return std::array<float, 3>{static_cast<float>(c.x()) + v.in[0],
                                  static_cast<float>(c.y()) + v.in[1],
                                  static_cast<float>(c.z()) + v.in[2]};
    };
    for (const ContourVertex& v : whole.contour().vertices) ++places[key(whole, v)];
    for (const auto& t : part.contour().triangles) {
      for (const std::uint32_t k : t) {
        ASSERT_TRUE(places.contains(key(part, part.contour().vertices[k])));
        ++compared;
      }
    }
  }
  EXPECT_GT(compared, 1000);
}

TEST(SurfaceMeshOfADig, HasTheSameBitsForAnyNumberOfThreads) {
  const Dug dug(make_dig("swing", placements()[1]), 0.05, 50);
  const auto with = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return mesh_all(dug.soil);
  };
  const Mesh one = with(1), four = with(4);
  EXPECT_EQ(one.triangles, four.triangles);
  EXPECT_EQ(one.points, four.points);
}

TEST(SurfaceDistance, IsTheBaseSurfacesOwnWhereNothingWasDug) {
  const Dug dug(make_dig("raster", placements()[1]), 0.05, 50);
  const Soil before(0.05, dug.soil.origin(),
                    {std::shared_ptr<const BaseSurface>(), &dug.soil.base()});
  std::int64_t same = 0;
  for (const Chunk* chunk : dug.soil.chunks()) {
    float phi[kChunkVoxels], base[kChunkVoxels];
    surface_distance(dug.soil, chunk->origin, phi);
    dug.soil.base().distance(dug.soil.world_from_index(chunk->origin.cast<double>()), 0.05,
                             dug.soil.band_m(), base);
    // A chunk of which, and of whose neighbours, no sample was changed.
    bool untouched = true;
    for (int k = 0; k < 27; ++k) {
      const Coord3 c = chunk->origin + kChunkSide * Coord3(k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1);
      SampleWords now, then;
      dug.soil.read_samples(c, now);
      before.read_samples(c, then);
      untouched &= now == then;
    }
    for (int n = 0; n < kChunkVoxels; ++n) {
      if (untouched) {
        ASSERT_EQ(phi[n], base[n]);
      }
      same += phi[n] == base[n] && std::abs(phi[n]) < dug.soil.band_m();
    }
  }
  EXPECT_GT(same, 100);
}

TEST(SurfaceDistance, IsTheTrueDistanceAndTheSameAloneAndInABatch) {
  // The mesh's own error near creases, and what a ball of steps of 0.02 and 300 directions misses.
  constexpr double kError = kVertexError + 0.05;
  for (const Solid& solid : solids()) {
    constexpr double h = 0.05;
    const auto soil = sampled(solid, h);
    std::vector<Coord3> chunks;
    for (const Chunk* chunk : soil->chunks()) chunks.push_back(chunk->origin);
    std::vector<std::array<float, kChunkVoxels>> all(chunks.size());
    surface_distances(*soil, chunks, [&](std::size_t i, const float* phi) {
      std::copy_n(phi, kChunkVoxels, all[i].begin());
    });
    int looked = 0, bad = 0;
    std::mt19937 random(1);
    for (std::size_t i = 0; i < chunks.size(); ++i) {
      if (i % 5 == 0) {
        float phi[kChunkVoxels];
        surface_distance(*soil, chunks[i], phi);
        for (std::size_t n = 0; n < kChunkVoxels; ++n) ASSERT_EQ(phi[n], all[i][n]);
      }
      for (int n = 0; n < kChunkVoxels; ++n) {
        const double phi = all[i][static_cast<std::size_t>(n)];
        if (random() % 16 != 0 || std::abs(phi) > 2.5 * h) continue;
        const Vec3 p = h * (chunks[i] + Coord3(n >> 6, n >> 3 & 7, n & 7)).cast<double>();
        const double truth = distance_m(solid, p, 0.02 * h);
        bad += std::abs(std::abs(phi) - truth) > kError * h;
        bad += (phi < 0) != (solid.f(p) < 0) && truth > kVertexError * h;
        ++looked;
      }
    }
    EXPECT_GT(looked, 100);
    EXPECT_LE(bad, looked / 50) << solid.name << " of " << looked;
  }
}

TEST(SurfaceHeight, IsThatOfTheHighestTriangleWhereBlocksMeetToo) {
  for (const double yaw : {0.0, 0.3, 0.9}) {
    const Solid trench = half_sine_trench(yaw);
    for (const double h : {0.05, 0.03}) {
      const auto soil = sampled(trench, h);
      const Mesh mesh = mesh_all(*soil);
      SurfaceHeight heights(*soil);
      std::mt19937 random(1);
      std::uniform_real_distribution<double> place(-0.55, 0.55), near(-1, 1);
      for (int k = 0; k < 1500; ++k) {
        Vec2 p(place(random), place(random));
        // Within a voxel of where blocks meet.
        p[k % 2] = h * (kBlockSide * std::round(p[k % 2] / (h * kBlockSide)) + near(random));
        double top = -1e9;
        for (const auto& t : mesh.triangles) {
          Vec3 v[3];
          for (std::size_t c = 0; c < 3; ++c) v[c] = mesh.points[t[c]].cast<double>();
          Eigen::Matrix2d sides;
          sides << (v[1] - v[0]).head<2>(), (v[2] - v[0]).head<2>();
          if (std::abs(sides.determinant()) < 1e-12) continue;
          const Vec2 w = sides.inverse() * (p - v[0].head<2>());
          if (w.minCoeff() < 0 || w.sum() > 1) continue;
          top = std::max(top, v[0].z() + w.x() * (v[1] - v[0]).z() + w.y() * (v[2] - v[0]).z());
        }
        if (top > -1e8) {
          ASSERT_NEAR(*heights.at(p.x(), p.y()), top, 1e-6) << p.transpose() / h;
        }
      }
    }
  }
}

TEST(SurfaceDistance, IsTheTrueOneOnAllSidesOfAChunkThatWasDug) {
  Soil soil(1, Vec3::Zero(), make_plane(100, {0, 0}));
  SampleWords all;
  all.fill(kAllSoil);
  SoilWriter(soil).remove(Coord3::Zero(), all);
  for (int n = 0; n < 27; ++n) {
    const Coord3 chunk = kChunkSide * Coord3(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
    float phi[kChunkVoxels];
    surface_distance(soil, chunk, phi);
    for (int k = 0; k < kChunkVoxels; ++k) {
      const Vec3 p = (chunk + Coord3(k >> 6, k >> 3 & 7, k & 7)).cast<double>();
      const Vec3 beyond = (p.array() - 3.5).abs() - 4;
      const double most = beyond.maxCoeff(), truth = most < 0 ? -most : -beyond.cwiseMax(0).norm();
      EXPECT_NEAR(phi[k], std::clamp(truth, -soil.band_m(), soil.band_m()), kVertexError)
          << p.transpose();
    }
  }
}

TEST(SurfaceHeight, IsTheBaseSurfacesOutsideAndTheFloorsInside) {
  const Solid box = ground_less("box", {0, 0}, {{Pose{}, Vec3(0.5, 0.4, 0.312)}});
  const auto soil = sampled(box, 0.05);
  EXPECT_EQ(*surface_height(*soil, 5, 5), box.height_m);
  EXPECT_NEAR(*surface_height(*soil, 0.7, 0.1), box.height_m, 1e-6);
  EXPECT_NEAR(*surface_height(*soil, 0.1, 0.1), -0.312, kSmoothError * 0.05 * 3);
}

TEST(SurfaceHeight, IsThatOfTheFloorAcrossTheBordersOfBlocks) {
  const Solid box =
      ground_less("box", {0, 0}, {{{Vec3::Zero(), from_rpy(0, 0, 0.5)}, Vec3(0.8, 0.8, 0.312)}});
  const auto soil = sampled(box, 0.05);
  SurfaceHeight heights(*soil);
  // The floor is flat, also where patches of the mesh meet: every 1.6 m, and a voxel before.
  for (int i = -20; i <= 20; ++i) {
    for (const Vec2& p : {Vec2(0.005 * i, 0.33), Vec2(0.33, 0.005 * i)})
      EXPECT_NEAR(*heights.at(p.x(), p.y()), -0.312, kVertexError * 0.05) << p.transpose();
  }
}

}  // namespace
}  // namespace soilvdb::testing
