// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface/surface_distance.h"

#include <algorithm>
#include <cmath>

#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/lattice/chunk_math.h"
#include "core/lattice/lanes.h"

namespace soilvdb::inline v0 {
namespace {

using Triangle = ContourDistance::Triangle;

constexpr float kBand = Ground::kBandVoxels;

using Float3 = Eigen::Vector3f;

void put_vector(float* to, const Float3& v) { std::copy_n(v.data(), 3, to); }

Triangle triangle(const Coord3& cell, const ContourVertex* const* vertices) {
  Triangle t{};
  t.cell = cell;
  t.base = true;
  Float3 corner[3], middle = Float3::Zero();
  for (int k = 0; k < 3; ++k) {
    const ContourVertex& v = *vertices[k];
    corner[k] = (v.cell - cell).cast<float>() + Float3(v.in[0], v.in[1], v.in[2]);
    put_vector(t.corner[k], corner[k]);
    middle += corner[k] / 3;
    t.base &= v.base;
  }
  put_vector(t.middle, middle);
  const Float3 across = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
  const float twice_area = across.norm();
  const Float3 normal =
      twice_area > kSliverArea ? Float3(across / twice_area) : Float3(Float3::Zero());
  // For a sliver only its edges count.
  t.beside = twice_area > kSliverArea ? 0.0f : 2 * kBand;
  put_vector(t.normal, normal);
  for (int k = 0; k < 3; ++k) {
    const Float3 edge = corner[(k + 1) % 3] - corner[k];
    put_vector(t.edge[k], edge);
    put_vector(t.inwards[k], normal.cross(edge));
    t.inverse_square[k] = 1 / std::max(edge.squaredNorm(), kMinEdgeSquare);
    t.radius = std::max(t.radius, (corner[k] - middle).norm() + kTriangleRounding);
  }
  return t;
}

/// Squared distance to a triangle of points whose z is in the lanes: to its plane for points above
/// it, to the nearest edge for others.
SOILVDB_INLINE Lanes squared_distance(const Triangle& t, float x, float y, Lanes z) {
  Lanes nearest{};
  LaneMask above = all_lanes(0) == 0;
  for (int k = 0; k < 3; ++k) {
    const float *const c = t.corner[k], *const e = t.edge[k], *const in = t.inwards[k];
    const float vx = x - c[0], vy = y - c[1];
    const Lanes vz = z - c[2];
    const Lanes along = ((vx * e[0] + vy * e[1]) + vz * e[2]) * t.inverse_square[k];
    const Lanes at = min(max(along, all_lanes(0)), all_lanes(1));
    const Lanes wx = vx - at * e[0], wy = vy - at * e[1], wz = vz - at * e[2];
    const Lanes square = wx * wx + (wy * wy + wz * wz);
    nearest = k == 0 ? square : min(nearest, square);
    above &= (vx * in[0] + vy * in[1]) + vz * in[2] >= 0;
  }
  const float* const n = t.normal;
  const Lanes off =
      ((x - t.corner[0][0]) * n[0] + (y - t.corner[0][1]) * n[1]) + (z - t.corner[0][2]) * n[2];
  const Lanes plane = off * off + t.beside * t.beside;
  return above ? min(plane, nearest) : nearest;
}

/// The nearest polygons of a row of eight voxels.
struct Nearest {
  Lanes square = all_lanes(kBand * kBand);
  LaneMask base = {};
};

/// @param row the first voxel @param reached largest distance in the row to a nearest polygon
SOILVDB_FOR_CPUS void look_at(const Triangle* begin, const Triangle* end, const Coord3& row,
                              Nearest& nearest, float& reached) {
  bool nearer = false;
  for (const Triangle* t = begin; t != end; ++t) {
    const Coord3 from = row - t->cell;
    const float x = static_cast<float>(from.x()), y = static_cast<float>(from.y()),
                z = static_cast<float>(from.z());
    const float dx = x - t->middle[0], dy = y - t->middle[1], below = z - t->middle[2];
    const float dz = std::max({below, -below - (kChunkSide - 1), 0.0f});
    const float within = reached + t->radius;
    if (dx * dx + (dy * dy + dz * dz) > within * within) continue;
    const Lanes square = squared_distance(*t, x, y, z + kLaneNumbers);
    const LaneMask less = square < nearest.square, same = square == nearest.square;
    const LaneMask base = t->base ? ~LaneMask{} : LaneMask{};
    nearest.base = less ? base : same ? (nearest.base | base) : nearest.base;
    nearest.square = min(nearest.square, square);
    nearer = true;
  }
  if (nearer) reached = std::sqrt(largest(nearest.square));
}

}  // namespace

ContourDistance::ContourDistance(const Ground& ground, const CellModels& models,
                                 const Contour& contour)
    : ground_(ground), models_(models) {
  const CellGrid& grid = models.grid();
  first_.assign(grid.cells() / static_cast<std::size_t>(grid.sides().z()) + 1, 0);
  triangles_.reserve(contour.triangles.size());
  for (std::size_t k = 0; k < contour.triangles.size(); ++k) {
    const ContourVertex* vertices[3];
    for (std::size_t v = 0; v < 3; ++v) vertices[v] = &contour.vertices[contour.triangles[k][v]];
    triangles_.push_back(triangle(grid.at(contour.edges[k]), vertices));
    ++first_[static_cast<std::size_t>(contour.edges[k] / grid.sides().z() + 1)];
  }
  for (std::size_t k = 1; k < first_.size(); ++k) first_[k] += first_[k - 1];
}

void ContourDistance::chunk(const Coord3& origin, float* phi_m) const {
  const CellGrid& grid = models_.grid();
  const Coord3 low = origin - grid.first();
  ground_.terrain().distance(ground_.world_from_index(origin.cast<double>()),
                             ground_.voxel_size_m(), ground_.band_m(), phi_m);
  if (!grid.any_change(low - Coord3::Constant(kPolygonsSeen + 1),
                       kChunkSide + 2 * (kPolygonsSeen + 1))) {
    return;
  }
  const float h = static_cast<float>(ground_.voxel_size_m()),
              band = static_cast<float>(ground_.band_m());
  for (int n = 0; n < kChunkVoxels; n += kChunkSide) {
    const Coord3 row = low + numbered_voxel(n);
    Nearest nearest;
    float reached = kBand;
    const auto column = [&](int x, int y) {
      const auto c = static_cast<std::size_t>(x * grid.sides().y() + y);
      if (first_[c] == first_[c + 1]) return;
      look_at(&triangles_[static_cast<std::size_t>(first_[c])], triangles_.data() + first_[c + 1],
              row, nearest, reached);
    };
    column(row.x(), row.y());
    for (int r = 1; r <= kPolygonsSeen && static_cast<float>(r) - kPolygonReach < reached; ++r) {
      for (int k = -r; k < r; ++k) {
        column(row.x() + k, row.y() - r);
        column(row.x() + r, row.y() + k);
        column(row.x() - k, row.y() + r);
        column(row.x() - r, row.y() - k);
      }
    }
    for (int z = 0; z < kChunkSide; ++z) {
      const bool in_soil = models_.soil(grid.id(row.x(), row.y(), row.z() + z));
      const float distance = std::sqrt(nearest.square[z]);
      float& phi = phi_m[n + z];
      if (nearest.base[z] != 0 && (phi < 0) == in_soil &&
          std::abs(std::abs(phi) - distance * h) <= kBaseDistanceTolerance * h) {
        continue;
      }
      const float metres = std::min(std::max(distance, kMinDistance) * h, band);
      phi = in_soil ? -metres : metres;
    }
  }
}

}  // namespace soilvdb::inline v0
