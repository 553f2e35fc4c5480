// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface_distance.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

namespace soilvdb {
namespace {

constexpr float kBand = 3;              // voxels
constexpr float kPolygonReach = 1.25f;  // of a polygon about the lower end of its edge, voxels
constexpr float kAgree = 0.1f;          // of the base surface and the contour on it, voxels
constexpr float kLeast = 1e-4f;         // voxels: no voxel is on the surface, for its sign's sake

using Float3 = Eigen::Vector3f;

/// Squared distance from the origin to a triangle (Ericson 2005, 5.1.5).
float squared_distance(const Float3& a, const Float3& b, const Float3& c) {
  const Float3 ab = b - a, ac = c - a;
  const float d1 = -ab.dot(a), d2 = -ac.dot(a);
  if (d1 <= 0 && d2 <= 0) return a.squaredNorm();
  const float d3 = -ab.dot(b), d4 = -ac.dot(b);
  if (d3 >= 0 && d4 <= d3) return b.squaredNorm();
  const float vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return (a + d1 / (d1 - d3) * ab).squaredNorm();
  const float d5 = -ab.dot(c), d6 = -ac.dot(c);
  if (d6 >= 0 && d5 <= d6) return c.squaredNorm();
  const float vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return (a + d2 / (d2 - d6) * ac).squaredNorm();
  const float va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    return (b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b)).squaredNorm();
  }
  const float scale = 1 / (va + (vb + vc));
  return (a + (ab * (vb * scale) + ac * (vc * scale))).squaredNorm();
}

constexpr int kSide = kLeafSide + 2 * kPolygonsSeen;

/// A triangle in voxels from the chunk's first voxel, and a ball around it.
struct Triangle {
  Float3 corner[3], middle;
  float radius;
  bool base;
};

/// The triangles by the lower end of their edge, in the chunk and around it.
struct Bins {
  std::array<int, kSide * kSide * kSide> first, count;
  static int id(const Coord3& c) { return (c.x() * kSide + c.y()) * kSide + c.z(); }

  /// In which ring around a bin the nearest triangle is; one more than there are: in none.
  int ring(const Coord3& c) const {
    int ring = 0;
    while (ring <= kPolygonsSeen &&
           (near[static_cast<std::size_t>(ring)][row(c.x(), c.y())] >> c.z() & 1) == 0) {
      ++ring;
    }
    return ring;
  }
  /// Calls `f(id)` for the bins of a ring that have triangles, in order.
  template <typename F>
  void for_ring(const Coord3& c, int ring, const F& f) const {
    const int z = c.z();
    const auto ends = static_cast<Row>(1 << (z - ring) | 1 << (z + ring));
    const auto all = static_cast<Row>(((2 << 2 * ring) - 1) << (z - ring));
    for (int x = c.x() - ring; x <= c.x() + ring; ++x) {
      for (int y = c.y() - ring; y <= c.y() + ring; ++y) {
        const bool border = std::max(std::abs(x - c.x()), std::abs(y - c.y())) == ring;
        Row bits = near[0][row(x, y)] & (border ? all : ends);
        for (; bits != 0; bits &= static_cast<Row>(bits - 1))
          f(static_cast<std::size_t>(id({x, y, std::countr_zero(bits)})));
      }
    }
  }
  void find_rings() {
    for (int x = 0; x < kSide; ++x) {
      for (int y = 0; y < kSide; ++y) {
        Row bits = 0;
        for (int z = 0; z < kSide; ++z)
          bits |= static_cast<Row>((count[static_cast<std::size_t>(id({x, y, z}))] > 0) << z);
        near[0][row(x, y)] = bits;
      }
    }
    for (std::size_t r = 1; r < near.size(); ++r) {
      const Rows& before = near[r - 1];
      Rows along{};
      for (int x = 0; x < kSide; ++x) {
        for (int y = 0; y < kSide; ++y) {
          Row bits = before[row(x, y)];
          if (y > 0) bits |= before[row(x, y - 1)];
          if (y + 1 < kSide) bits |= before[row(x, y + 1)];
          along[row(x, y)] = static_cast<Row>(bits | bits << 1 | bits >> 1);
        }
      }
      for (int x = 0; x < kSide; ++x) {
        for (int y = 0; y < kSide; ++y) {
          Row& bits = near[r][row(x, y)] = along[row(x, y)];
          if (x > 0) bits |= along[row(x - 1, y)];
          if (x + 1 < kSide) bits |= along[row(x + 1, y)];
        }
      }
    }
  }

 private:
  using Row = std::uint16_t;  // a bit for each bin upwards
  static_assert(kSide == 16);
  using Rows = std::array<Row, kSide * kSide>;
  static std::size_t row(int x, int y) { return static_cast<std::size_t>(x * kSide + y); }
  std::array<Rows, kPolygonsSeen + 1> near;  ///< with a triangle within so many rings
};

}  // namespace

void contour_distance(const Soil& soil, const CellModels& models, const Contour& contour,
                      const Coord3& chunk, float* phi_m) {
  const CellGrid& grid = models.grid();
  const Coord3 low = chunk - grid.first();
  soil.base().distance(soil.world_from_index(chunk.cast<double>()), soil.voxel_size_m(),
                       soil.band_m(), phi_m);
  if (!grid.any_change(low - Coord3::Constant(kPolygonsSeen + 1), kSide + 2)) return;

  const auto bins = std::make_unique<Bins>();
  bins->count.fill(0);
  const Coord3 corner = low - Coord3::Constant(kPolygonsSeen);
  std::vector<Triangle> triangles;
  for (std::size_t k = 0; k < contour.triangles.size(); ++k) {
    const Coord3 c = grid.at(contour.edges[k]) - corner;
    if ((c.array() < 0).any() || (c.array() >= kSide).any()) continue;
    const std::size_t bin = static_cast<std::size_t>(Bins::id(c));
    if (bins->count[bin]++ == 0) bins->first[bin] = static_cast<int>(triangles.size());
    Triangle t{};
    t.base = true;
    for (int v = 0; v < 3; ++v) {
      const ContourVertex& vertex =
          contour.vertices[contour.triangles[k][static_cast<std::size_t>(v)]];
      t.corner[v] =
          (vertex.cell - low).cast<float>() + Float3(vertex.in[0], vertex.in[1], vertex.in[2]);
      t.base &= vertex.base;
    }
    t.middle = (t.corner[0] + t.corner[1] + t.corner[2]) / 3;
    for (const Float3& v : t.corner) t.radius = std::max(t.radius, (v - t.middle).norm() + 1e-3f);
    triangles.push_back(t);
  }
  bins->find_rings();
  const float h = static_cast<float>(soil.voxel_size_m()), band = static_cast<float>(soil.band_m());
  for (int n = 0; n < kLeafSize; ++n) {
    const Coord3 in(n >> 6, n >> 3 & 7, n & 7), cell = low + in;
    const Float3 at = in.cast<float>();
    float best = kBand * kBand, reached = kBand;
    bool base = false, found = false;
    const Coord3 bin = in + Coord3::Constant(kPolygonsSeen);
    for (int ring = bins->ring(bin);
         ring <= kPolygonsSeen && static_cast<float>(ring) - kPolygonReach < reached; ++ring) {
      bins->for_ring(bin, ring, [&](std::size_t b) {
        for (int k = bins->first[b], end = k + bins->count[b]; k < end; ++k) {
          const Triangle& t = triangles[static_cast<std::size_t>(k)];
          const float within = reached + t.radius;
          if ((t.middle - at).squaredNorm() > within * within) continue;
          const float d = squared_distance(t.corner[0] - at, t.corner[1] - at, t.corner[2] - at);
          if (d > best || (d == best && (base || !t.base))) continue;
          best = d;
          reached = std::sqrt(d);
          base = t.base;
          found = true;
        }
      });
    }
    const bool in_soil = models.soil(grid.id(cell.x(), cell.y(), cell.z()));
    float& phi = phi_m[n];
    if (base && (phi < 0) == in_soil && std::abs(std::abs(phi) - reached * h) <= kAgree * h) {
      continue;
    }
    const float distance = found ? std::min(std::max(reached, kLeast) * h, band) : band;
    phi = in_soil ? -distance : distance;
  }
}

}  // namespace soilvdb
