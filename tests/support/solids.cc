// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tests/support/solids.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <numbers>

#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::test {
namespace {

constexpr double kHeight = 0.0093;  // off the lattice
const Vec3 kPlace(0.0131, 0.0077, kHeight);

using Field = std::function<double(const Vec3&)>;

Field ground(double height, const Vec2& slope) {
  const double cosine = 1 / std::hypot(1.0, slope.norm());
  return [=](const Vec3& p) { return (p.z() - height - slope.dot(p.head<2>())) * cosine; };
}

}  // namespace

Solid ground_less(std::string name, const Vec2& slope, const std::vector<Box>& boxes) {
  Solid s{std::move(name), kHeight, slope, {ground(kHeight, slope)}, {}, {}};
  for (const Box& box : boxes) {
    for (int a = 0; a < 3; ++a) {
      s.features.push_back([=](const Vec3& p) {
        return box.half[a] - std::abs((box.world_from_box.inverse() * p)[a]);
      });
    }
    for (int k = 0; k < 8; ++k) {
      const Vec3 corner(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1);
      s.hollow.extend(box.world_from_box * corner.cwiseProduct(box.half));
    }
  }
  s.f = [boxes, before = s.features[0]](const Vec3& p) {
    double v = before(p);
    for (const Box& box : boxes) {
      v = std::max(v, (box.half - (box.world_from_box.inverse() * p).cwiseAbs()).minCoeff());
    }
    return v;
  };
  return s;
}

Solid half_sine_trench(double yaw_rad) {
  constexpr double kA = 0.5, kB = 0.25, kHalfWidth = 0.3;
  const Pose place{kPlace, from_rpy(0, 0, yaw_rad)};
  const auto floor = [=](const Vec3& world) {
    const Vec3 p = place.inverse() * world;
    const double x = p.x() / kA, z = p.z() / kB, g = std::hypot(x, z);
    const double gradient = std::hypot(x / kA, z / kB);  // of g^2 / 2
    return gradient < 1e-9 ? kB : (1 - g) * g / gradient;
  };
  const auto sides = [=](const Vec3& world) {
    return kHalfWidth - std::abs((place.inverse() * world).y());
  };
  Solid s{"half-sine trench", kHeight, Vec2::Zero(), {}, {}, {}};
  s.features = {ground(kHeight, s.slope), floor, sides};
  s.f = [=, before = s.features[0]](const Vec3& p) {
    return std::max(before(p), std::min(floor(p), sides(p)));
  };
  s.hollow = {Vec3(-0.65, -0.65, -0.3), Vec3(0.65, 0.65, 0.1)};
  return s;
}

Solid thin_wall(double thickness_m, double roll, double yaw, double first_face_m) {
  Pose middle{kPlace, from_rpy(roll, 0, yaw)};
  middle.position.y() = first_face_m + thickness_m / 2;
  std::vector<Box> boxes;
  for (const double side : {1.0, -1.0}) {
    Box box{middle, Vec3(0.4, 0.2, 0.3)};
    box.world_from_box.position = middle * Vec3(0, side * (0.2 + thickness_m / 2), 0);
    boxes.push_back(box);
  }
  return ground_less("thin wall", Vec2::Zero(), boxes);
}

Solid thin_slot(double thickness_m, double roll, double yaw, double first_face_m) {
  Pose middle{kPlace, from_rpy(roll, 0, yaw)};
  middle.position.y() = first_face_m + thickness_m / 2;
  return ground_less("thin slot", Vec2::Zero(), {{middle, Vec3(0.4, thickness_m / 2, 0.3)}});
}

const std::vector<Solid>& known_solids() {
  constexpr double kDegree = std::numbers::pi / 180;
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

std::unique_ptr<Ground> sampled(const Solid& solid, double h) {
  auto ground = std::make_unique<Ground>(h, Vec3::Zero(), make_plane(solid.height_m, solid.slope));
  const Vec3 margin = Vec3::Constant(4);
  const Coord3 low = ((solid.hollow.min() / h - margin) / kChunkSide).array().floor().cast<int>();
  const Coord3 high = ((solid.hollow.max() / h + margin) / kChunkSide).array().floor().cast<int>();
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int z = low.z(); z <= high.z(); ++z) {
        const Coord3 origin = kChunkSide * Coord3(x, y, z);
        SampleWords words;
        ground->read_samples(origin, words);
        const SampleWords before = words;
        for (std::size_t n = 0; n < words.size(); ++n) {
          const int k = static_cast<int>(n);
          const Coord3 voxel = origin + numbered_voxel(k);
          const CellPoints& points = sample_points(voxel);
          for (std::uint64_t left = words[n]; left != 0; left &= left - 1) {
            const int i = std::countr_zero(left);
            const Vec3 in(points.x[i] - 0.5, points.y[i] - 0.5, points.z[i] - 0.5);
            if (solid.f(h * (voxel.cast<double>() + in)) >= 0) words[n] &= ~(left & -left);
          }
        }
        if (words == before) continue;
        for (std::size_t n = 0; n < words.size(); ++n) words[n] ^= before[n];
        GroundWriter(*ground).remove(origin, words);
      }
    }
  }
  return ground;
}

std::unique_ptr<Ground> sampled(const std::function<double(const Vec3&)>& f) {
  auto ground = std::make_unique<Ground>(1, Vec3::Zero(), make_plane(100, {0, 0}));
  for (int c = 0; c < 27; ++c) {
    const Coord3 origin = kChunkSide * step_around(c);
    SampleWords air;
    for (std::size_t k = 0; k < air.size(); ++k) {
      const int v = static_cast<int>(k);
      const Coord3 voxel = origin + numbered_voxel(v);
      const CellPoints& p = sample_points(voxel);
      air[k] = 0;
      for (int s = 0; s < 64; ++s) {
        const Vec3 at = voxel.cast<double>() + Vec3(p.x[s] - 0.5, p.y[s] - 0.5, p.z[s] - 0.5);
        air[k] |= std::uint64_t{!(f(at) < 0)} << s;
      }
    }
    GroundWriter(*ground).remove(origin, air);
  }
  return ground;
}

double below_ground_m3(const Mesh& mesh, const Solid& solid) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    Vec3 p[3];
    for (std::size_t k = 0; k < 3; ++k) {
      p[k] = mesh.points[t[k]].cast<double>();
      p[k].z() -= solid.height_m + solid.slope.dot(p[k].head<2>());
    }
    const Vec3 a = p[1] - p[0], b = p[2] - p[0];
    sum -= (a.x() * b.y() - a.y() * b.x()) / 2 * (p[0].z() + p[1].z() + p[2].z()) / 3;
  }
  return sum;
}

double distance_m(const Solid& solid, const Vec3& p, double step_m) {
  constexpr int kDirections = 300;
  constexpr double kGoldenAngle = 2.399963229728653;
  static const std::vector<Vec3> directions = [] {
    std::vector<Vec3> all;
    for (int i = 0; i < kDirections; ++i) {
      const double z = 1 - 2 * (i + 0.5) / kDirections, r = std::sqrt(1 - z * z);
      all.emplace_back(r * std::cos(i * kGoldenAngle), r * std::sin(i * kGoldenAngle), z);
    }
    return all;
  }();
  const bool soil = solid.f(p) < 0;
  constexpr int kParts = 1000;
  for (int k = 1; k < kParts; ++k) {
    for (const Vec3& d : directions) {
      if ((solid.f(p + k * step_m * d) < 0) != soil) return (k - 0.5) * step_m;
    }
  }
  return kParts * step_m;
}

int features_near(const Solid& solid, const Vec3& p, double distance_m) {
  return static_cast<int>(
      std::count_if(solid.features.begin(), solid.features.end(),
                    [&](const auto& feature) { return std::abs(feature(p)) < distance_m; }));
}

Faults faults(const Mesh& mesh, const Ground& ground) {
  Faults found;
  const double h = ground.voxel_size_m();
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.points[t[0]].cast<double>(), b = mesh.points[t[1]].cast<double>(),
               c = mesh.points[t[2]].cast<double>();
    // What single precision leaves of points on one line a kilometre away is more than that.
    found.without_area += (b - a).cross(c - a).norm() < 1e-9 * h * h;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t from = t[k], to = t[(k + 1) % 3];
      ++edges[{std::min(from, to), std::max(from, to)}];
    }
  }
  for (const auto& [edge, count] : edges) {
    found.crowded += count > 2;
    if (count != 1) continue;
    const Vec3 index = (mesh.points[edge.first] + mesh.points[edge.second]).cast<double>() / 2 / h;
    bool rim = false;
    for (int k = 0; k < 27; ++k) {
      const Vec3 step = 1.5 * step_around(k).cast<double>();
      const Coord3 chunk =
          ((index + step) / kChunkSide).array().floor().matrix().cast<int>() * kChunkSide;
      rim |= ground.find(chunk) == nullptr;
    }
    found.torn += !rim;
  }
  return found;
}

}  // namespace soilvdb::test
