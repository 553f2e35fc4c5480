// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Buckets from meshes, whose volume is counted by voxels and rays that share no code with the
// reader.
#include "soilvdb/io/bucket_mesh.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>

#include "soilvdb/capacity.h"
#include "soilvdb/io/error.h"
#include "soilvdb/io/mesh_file.h"
#include "tests/support/sanitized.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace bucket_mesh_test {

using ::testing::HasSubstr;
using Random = std::mt19937;

double between(Random& random, double low, double high) {
  return std::uniform_real_distribution(low, high)(random);
}

/// A closed part, in the bucket frame, m.
struct Part {
  std::vector<Vec3> points;
  std::vector<std::array<std::size_t, 3>> triangles;

  void quad(std::size_t a, std::size_t b, std::size_t c, std::size_t d) {
    triangles.push_back({a, b, c});
    triangles.push_back({a, c, d});
  }
};

/// The steel between two lines of the side view, from y = low to y = high.
Part strip(const std::vector<Vec2>& one, const std::vector<Vec2>& other, double low, double high) {
  Part part;
  for (std::size_t k = 0; k < one.size(); ++k)
    for (const Vec2& p : {one[k], other[k]})
      for (const double y : {low, high}) part.points.emplace_back(p.x(), y, p.y());
  // Of point k: 4 k is of one, low; + 1 high; + 2 is of the other.
  part.quad(0, 1, 3, 2);
  for (std::size_t k = 0; k + 1 < one.size(); ++k) {
    const std::size_t a = 4 * k, b = a + 4;
    part.quad(a, a + 1, b + 1, b);
    part.quad(a + 2, b + 2, b + 3, a + 3);
    part.quad(a, b, b + 2, a + 2);
    part.quad(a + 1, a + 3, b + 3, b + 1);
  }
  const std::size_t end = 4 * (one.size() - 1);
  part.quad(end, end + 2, end + 3, end + 1);
  return part;
}

struct Shape {
  double width_m = 0, height_m = 0, taper = 0;
  std::vector<Vec2> profile;
  std::vector<Part> parts;
};

std::vector<Vec2> offset(const std::vector<Vec2>& line, double by_m) {
  std::vector<Vec2> out;
  for (std::size_t k = 0; k < line.size(); ++k) {
    const Vec2 along =
        (line[std::min(k + 1, line.size() - 1)] - line[k > 0 ? k - 1 : 0]).normalized();
    out.push_back(line[k] + by_m * Vec2(-along.y(), along.x()));  // on the left is the outside
  }
  return out;
}

/// A bucket with floor, sides, teeth, lugs and a pin, whose parts intersect.
Shape shape_of(Random& random, double taper) {
  Shape s{between(random, 0.3, 2.5), between(random, 0.4, 1.6), taper, {}, {}};
  const double h = s.height_m, depth = h * between(random, 0.5, 0.9);
  const double belly = h * between(random, -0.05, 0.25), wave = between(random, -0.12, 0.12);
  const double plate = h * between(random, 0.01, 0.03);
  const int n = 12 + static_cast<int>(random() % 20);
  for (int k = 0; k <= n; ++k) {
    const double t = double(k) / n, sine = std::sin(M_PI * t);
    s.profile.emplace_back(
        k == 0 || k == n ? 0 : -depth * sine * (1 + wave * std::sin(3 * M_PI * t)),
        h * (0.5 - 0.5 * std::cos(M_PI * t)) - belly * sine * (1 - t));
  }
  const std::vector<Vec2> outer = offset(s.profile, plate), middle = offset(s.profile, plate / 2);
  const double side = s.width_m / 2;
  s.parts.push_back(strip(s.profile, outer, -side - plate, side + plate));
  std::vector<Vec2> mouth;
  for (int k = 0; k <= n; ++k) mouth.emplace_back(0, h * k / n);
  std::vector<Vec2> edge = middle;
  edge.front() = s.profile.front();
  edge.back() = s.profile.back();
  s.parts.push_back(strip(edge, mouth, side, side + plate));
  s.parts.push_back(strip(edge, mouth, -side - plate, -side));
  const Vec2 ahead = (s.profile[0] - s.profile[1]).normalized(), below(-ahead.y(), ahead.x());
  for (int k = 0; k < 5; ++k) {
    const double y = (k - 2) * 0.48 * side, half = 0.08 * side;
    const Vec2 out = below.dot(outer[0] - s.profile[0]) > 0 ? below : Vec2(-below);
    s.parts.push_back(strip({-0.1 * h * ahead + plate / 2 * out, 0.03 * h * ahead},
                            {-0.1 * h * ahead + 2 * plate * out, 0.2 * h * ahead + plate * out},
                            y - half, y + half));
  }
  for (const double y : {-0.3 * side, 0.3 * side})
    s.parts.push_back(strip({{-0.3 * h, h - plate}, {0.05 * h, h + plate}},
                            {{-0.2 * h, 1.3 * h}, {0.08 * h, 1.3 * h}}, y - plate, y + plate));
  s.parts.push_back(strip({{-0.03 * h, 1.1 * h}, {0.03 * h, 1.1 * h}},
                          {{-0.03 * h, 1.16 * h}, {0.03 * h, 1.16 * h}}, -0.3 * side, 0.3 * side));
  for (Part& part : s.parts)
    for (Vec3& p : part.points) p.y() *= 1 + taper * std::min(0.0, p.x()) / depth;
  return s;
}

/// The distances at which a line through p along an axis crosses triangles.
template <typename F>
void crossings(const Part& part, const Vec3& p, int axis, const F& found) {
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  for (const auto& t : part.triangles) {
    const Vec3 &a = part.points[t[0]], &b = part.points[t[1]], &c = part.points[t[2]];
    const auto turn = [&](const Vec3& from, const Vec3& to) {
      return (to[u] - from[u]) * (p[v] - from[v]) - (to[v] - from[v]) * (p[u] - from[u]);
    };
    const double ab = turn(a, b), bc = turn(b, c), ca = turn(c, a);
    if ((ab < 0) != (bc < 0) || (bc < 0) != (ca < 0) || ab + bc + ca == 0) continue;
    found((a[axis] * bc + b[axis] * ca + c[axis] * ab) / (ab + bc + ca) - p[axis]);
  }
}

/// Behind the mouth, in no steel, with steel on both sides, below, above and behind.
bool is_in_bucket(const Shape& shape, const Vec3& p) {
  bool seen[3][2] = {};
  for (const Part& part : shape.parts) {
    for (int axis = 0; axis < 3; ++axis) {
      int before = 0;
      crossings(part, p, axis, [&](double distance) {
        before += distance > 0;
        seen[axis][distance > 0] = true;
      });
      if (axis == 1 && before % 2 == 1) return false;
    }
  }
  return seen[0][0] && seen[1][0] && seen[1][1] && seen[2][0] && seen[2][1];
}

/// Of each voxel a random point counts.
double struck_by_voxels(const Shape& shape, Random& random) {
  Eigen::AlignedBox3d box;
  for (const Vec2& p : shape.profile) box.extend(Vec3(p.x(), 0, p.y()));
  box.extend(Vec3(0, -shape.width_m / 2, 0));
  box.extend(Vec3(0, shape.width_m / 2, 0));
  const Eigen::Array3i n(32, 24, 40);
  const Vec3 voxel = box.sizes().array() / n.cast<double>();
  long count = 0;
  for (int i = 0; i < n[0]; ++i) {
    for (int j = 0; j < n[1]; ++j) {
      for (int k = 0; k < n[2]; ++k) {
        const Vec3 at(i + between(random, 0, 1), j + between(random, 0, 1),
                      k + between(random, 0, 1));
        count += is_in_bucket(shape, box.min() + voxel.cwiseProduct(at));
      }
    }
  }
  return double(count) * voxel.prod();
}

double area_of(const std::vector<Vec2>& profile) {
  double twice = 0;
  for (std::size_t k = 0; k < profile.size(); ++k) {
    const Vec2 &a = profile[k], &b = profile[(k + 1) % profile.size()];
    twice += a.x() * b.y() - a.y() * b.x();
  }
  return std::abs(twice) / 2;
}

/// The mesh in a file, somewhere, in some unit.
struct Placed {
  std::filesystem::path file;
  Pose file_from_bucket;  // m
  double unit_m = 1;

  Vec3 to_file(const Vec3& p) const { return (file_from_bucket * p) / unit_m; }
  MouthEdges edges(const Shape& s, double off_m = 0) const {
    const double y = s.width_m / 2;
    return {{to_file({-off_m, -y, 0}), to_file({-off_m, y, 0})}, std::nullopt};
  }
};

Placed placed(const Shape& shape, const std::filesystem::path& file, const Pose& pose,
              double unit_m) {
  Placed as{file, pose, unit_m};
  Mesh mesh;
  for (const Part& part : shape.parts) {
    const auto first = static_cast<std::uint32_t>(mesh.points.size());
    for (const Vec3& p : part.points) mesh.points.push_back(as.to_file(p).cast<float>());
    for (const auto& t : part.triangles) {
      mesh.triangles.push_back({first + static_cast<std::uint32_t>(t[0]),
                                first + static_cast<std::uint32_t>(t[1]),
                                first + static_cast<std::uint32_t>(t[2])});
    }
  }
  write_mesh(file, mesh, Vec3::Zero(), "");
  return as;
}

Pose any_pose(Random& random) {
  Eigen::Vector4d q;
  for (double& v : q) v = between(random, -1, 1);
  return {Vec3(between(random, -3, 3), between(random, -3, 3), between(random, -3, 3)),
          Eigen::Quaterniond(q.normalized())};
}

double struck_of(const Bucket& bucket) { return Capacity::of(bucket)->struck_m3(); }

TEST(BucketMesh, HoldsTheStruckVolumeThatVoxelsCount) {
  const test::TempFolder folder;
  for (unsigned seed = 0; seed < 24; seed += test::kLong ? 1 : 7) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const Shape shape = shape_of(random, seed % 2 == 0 ? 0 : between(random, 0, 0.15));
    const Placed at = placed(shape, folder / (seed % 3 == 0 ? "bucket.stl" : "bucket.obj"),
                             any_pose(random), seed % 4 < 2 ? 0.001 : 1);
    MouthEdges edges = at.edges(shape);
    if (seed % 5 == 0) std::swap(edges.lip[0], edges.lip[1]);
    const MeshBucket made = read_bucket_mesh(at.file, edges, at.unit_m);
    const double struck_m3 = struck_of(made.bucket);
    EXPECT_NEAR(struck_m3 / struck_by_voxels(shape, random), 1, 0.02);
    if (shape.taper == 0) {
      EXPECT_NEAR(made.bucket.width_m / shape.width_m, 1, 0.005);
      EXPECT_NEAR(struck_m3 / (area_of(shape.profile) * shape.width_m), 1, 0.003);
    }
    EXPECT_NEAR(made.bucket.height_m / shape.height_m, 1, 1e-4);
    EXPECT_LT(made.bucket.profile.size(), 60U);
    // Placed by its pose, the mouth is where it is in the file.
    EXPECT_LT(travel(made.bucket, made.mesh_from_bucket, at.file_from_bucket), 1e-4);
  }
}

TEST(BucketMesh, TakesEdgesAsSomeoneReadsThemOff) {
  const test::TempFolder folder;
  Random random(7);
  const Shape shape = shape_of(random, 0);
  const Placed at = placed(shape, folder / "bucket.obj", any_pose(random), 1);
  const double truth_m3 = area_of(shape.profile) * shape.width_m;
  for (int k = 0; k < 10; ++k) {
    MouthEdges edges = at.edges(shape);
    const double off_m = 0.005 * shape.width_m;
    for (Vec3& end : edges.lip)
      for (double& v : end) v += between(random, -off_m, off_m);
    if (k % 2 == 0)
      edges.upper = at.to_file({0, between(random, -0.4, 0.4) * shape.width_m, shape.height_m});
    EXPECT_NEAR(struck_of(read_bucket_mesh(at.file, edges).bucket) / truth_m3, 1, 0.02) << k;
  }
}

TEST(BucketMesh, NeedsNoClosedMesh) {
  const test::TempFolder folder;
  Random random(3);
  Shape shape = shape_of(random, 0);
  // A tenth of the triangles of the outer side is missing: the inner side is as it was.
  Part& shell = shape.parts[0];
  for (std::size_t k = 4; k < shell.triangles.size(); k += 80)
    shell.triangles.erase(shell.triangles.begin() + static_cast<std::ptrdiff_t>(k));
  const Placed at = placed(shape, folder / "bucket.obj", any_pose(random), 1);
  EXPECT_NEAR(struck_of(read_bucket_mesh(at.file, at.edges(shape)).bucket) /
                  (area_of(shape.profile) * shape.width_m),
              1, 0.003);
}

TEST(BucketMesh, SaysWhatIsWrongAndWhatWouldBeRight) {
  const test::TempFolder folder;
  Random random(5);
  Shape shape = shape_of(random, 0);
  const Placed at = placed(shape, folder / "bucket.obj", any_pose(random), 0.001);
  const MouthEdges right = at.edges(shape);
  const auto said = [&](const std::filesystem::path& file, const MouthEdges& edges, double unit_m) {
    const std::string message =
        test::message_of(folder, [&] { read_bucket_mesh(file, edges, unit_m); });
    EXPECT_EQ(message.find('\n'), std::string::npos);
    return message;
  };
  EXPECT_THAT(said(folder / "none.obj", right, 0.001), HasSubstr("none.obj: "));
  EXPECT_THAT(said(folder.write("text.obj", "hello\n"), right, 0.001),
              HasSubstr("has no triangles"));
  EXPECT_THAT(said(at.file, right, 0), HasSubstr("unit is 0; it must be the metres per unit"));
  EXPECT_THAT(said(at.file, right, 1),
              HasSubstr("m long with a unit of 1; unit must be the metres per unit of the file"));
  MouthEdges edges = right;
  edges.lip[1] += Vec3(0, 0, 500);
  EXPECT_THAT(said(at.file, edges, 0.001),
              HasSubstr("off the mesh; the nearest point of the mesh is ("));
  edges = right;
  edges.lip[1] = edges.lip[0];
  EXPECT_THAT(said(at.file, edges, 0.001), HasSubstr("lip has the same point twice"));
  edges = right;
  edges.lip[1].x() = NAN;
  EXPECT_THAT(said(at.file, edges, 0.001), HasSubstr("its coordinates must be finite"));
  edges = right;
  edges.upper = edges.lip[0];
  EXPECT_THAT(said(at.file, edges, 0.001), HasSubstr("upper is on the lip"));
  // Tips of teeth are no edge.
  edges = right;
  const Part &tooth = shape.parts[3], &other = shape.parts[7];
  edges.lip = {at.to_file((tooth.points[6] + tooth.points[7]) / 2),
               at.to_file((other.points[6] + other.points[7]) / 2)};
  EXPECT_THAT(said(at.file, edges, 0.001), HasSubstr("not the tips of teeth"));
  // Without sides, or with a hole across the floor.
  Shape broken = shape;
  broken.parts.erase(broken.parts.begin() + 1, broken.parts.begin() + 3);
  EXPECT_THAT(
      said(placed(broken, folder / "no_sides.obj", at.file_from_bucket, 0.001).file, right, 0.001),
      HasSubstr("has no side plate beside the end ("));
  broken = shape;
  Part& shell = broken.parts[0];
  shell.triangles.erase(shell.triangles.begin() + 34, shell.triangles.begin() + 42);
  EXPECT_THAT(
      said(placed(broken, folder / "open.obj", at.file_from_bucket, 0.001).file, right, 0.001),
      HasSubstr("the outline is open in 33 of 33 sections"));
}

TEST(BucketMesh, TakesOrRefusesWhateverItIsGiven) {
  const test::TempFolder folder;
  Random random(11);
  const Shape shape = shape_of(random, 0);
  int taken = 0;
  for (int k = 0; k < (test::kLong ? 16 : 4); ++k) {
    Shape broken = shape;
    for (Part& part : broken.parts) {
      for (Vec3& p : part.points)
        if (random() % 200 == 0) p *= std::pow(10, between(random, -4, 25 * double(k % 2)));
      std::erase_if(part.triangles, [&](const auto&) { return random() % 50 == 0; });
    }
    const Placed at = placed(broken, folder / "broken.obj", Pose{}, 1);
    MouthEdges edges = at.edges(shape);
    const auto any_point = [&] {
      const Part& part = broken.parts[random() % broken.parts.size()];
      return part.points[random() % part.points.size()];
    };
    if (random() % 2 == 0) edges.lip[random() % 2] = any_point();
    if (random() % 2 == 0) edges.upper = any_point();
    try {
      read_bucket_mesh(at.file, edges).bucket.validate();
      ++taken;
    } catch (const InputError&) {
    }
  }
  EXPECT_GT(taken, 0);
}

}  // namespace bucket_mesh_test
}  // namespace soilvdb::io
