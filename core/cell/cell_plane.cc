// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cell/cell_plane.h"

#include <algorithm>
#include <bit>

#include "core/cell/plane_mask.h"
#include "core/constants.h"

namespace soilvdb::inline v0 {
namespace {

/// The misfit of the 27 words with a plane.
struct Residual {
  float area, a[6];  // of the plane in the cells, and its moments in the tangents
  int wrong, most;   // samples, in all and in a cell
  /// The cells that have wrong ones, in order.
  struct Cell {
    std::uint64_t wrong, word;
    const CellPoints* points;  // null if the plane misses the cell: all points count as its middle
    float x, y, z;
  } cells[27];
  int size;
};

SOILVDB_INLINE void evaluate(const CellGrid& grid, int id, const CellPlane& plane,
                             const Tangents& t, bool slab, Residual& r) {
  r.area = 0;
  std::fill_n(r.a, 6, 0.0f);
  r.wrong = r.most = r.size = 0;
  const float half_range = plane.half_range() + kCellFaceMargin;
  const float ax = std::abs(plane.nx), ay = std::abs(plane.ny), az = std::abs(plane.nz);
  const float most = std::max({ax, ay, az}), sum = ax + ay + az;
  // A plane in the face between two cells is half in each.
  const float steepness = 1 / std::max(sum - most, 2 * kCellFaceMargin), largest = 1 / most;
  const std::uint64_t* const words = grid.words();
  const int sx = grid.step(0), sy = grid.step(1);
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        const float fx = static_cast<float>(x), fy = static_cast<float>(y),
                    fz = static_cast<float>(z);
        const float s = plane.signed_distance(fx, fy, fz);
        const int here_id = id + x * sx + y * sy + z;
        const std::uint64_t word = words[here_id];
        const CellPoints* points = nullptr;
        std::uint64_t wrong;
        if (std::abs(s) >= half_range) {
          if (slab) continue;
          wrong = s < 0 ? ~word : word;
        } else {
          // Area of the plane in the cell: exact along axes and diagonals.
          const float a =
              std::min(std::max(0.5f + (most / 2 - std::abs(s)) * steepness, 0.0f), 1.0f) * largest;
          const float u = t.u[0] * fx + (t.u[1] * fy + t.u[2] * fz);
          const float v = t.v[0] * fx + (t.v[1] * fy + t.v[2] * fz);
          r.area += a;
          r.a[0] += a;
          r.a[1] += a * u;
          r.a[2] += a * v;
          r.a[3] += a * (u * u + 1.0f / 12);
          r.a[4] += a * u * v;
          r.a[5] += a * (v * v + 1.0f / 12);
          points = &grid.points(here_id);
          CellPlane here = plane;
          here.d = -s;
          wrong = plane_mask(*points, here) ^ word;
          if (wrong != 0 && slab) {
            CellPlane side = here;
            side.d = here.d - kSideFitHalfSlab;
            wrong &= ~plane_mask(*points, side);
            side.d = here.d + kSideFitHalfSlab;
            wrong &= plane_mask(*points, side);
          }
        }
        if (wrong == 0) continue;
        const int n = std::popcount(wrong);
        r.wrong += n;
        r.most = std::max(r.most, n);
        r.cells[r.size++] = {wrong, word, points, fx, fy, fz};
      }
    }
  }
}

/// How the wrong samples push: soil outwards, air inwards; and tilt.
SOILVDB_INLINE void push_tangents(const Residual& r, const Tangents& t, float* b) {
  b[0] = b[1] = b[2] = 0;
  for (int k = 0; k < r.size; ++k) {
    const Residual::Cell& c = r.cells[k];
    const auto more =
        static_cast<float>(2 * std::popcount(c.wrong & c.word) - std::popcount(c.wrong));
    float px = more * c.x, py = more * c.y, pz = more * c.z;
    if (c.points != nullptr) {  // which are from the cell's corner
      px -= more / 2;
      py -= more / 2;
      pz -= more / 2;
      for (std::uint64_t wrong = c.wrong; wrong != 0; wrong &= wrong - 1) {
        const int i = std::countr_zero(wrong);
        const float sign = c.word >> i & 1 ? 1.0f : -1.0f;
        px += sign * c.points->x[i];
        py += sign * c.points->y[i];
        pz += sign * c.points->z[i];
      }
    }
    b[0] += more;
    b[1] += t.u[0] * px + (t.u[1] * py + t.u[2] * pz);
    b[2] += t.v[0] * px + (t.v[1] * py + t.v[2] * pz);
  }
}

SOILVDB_INLINE void improve(const Residual& r, const Tangents& t, CellPlane& plane) {
  float b[3];
  push_tangents(r, t, b);
  displace(plane, t, r.a, b, kMaxFitStep);
}

/// Normal by the gradient of counts (Youngs 1984), offset by the cell's own count.
CellPlane by_gradient(const CellGrid& grid, int id) {
  constexpr int kWeights[3] = {1, 2, 1};
  int g[3] = {0, 0, 0};
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        const int n = grid.count(id + x * grid.step(0) + y * grid.step(1) + z);
        const int wx = kWeights[x + 1], wy = kWeights[y + 1], wz = kWeights[z + 1];
        g[0] -= x * wy * wz * n;
        g[1] -= y * wx * wz * n;
        g[2] -= z * wx * wy * n;
      }
    }
  }
  CellPlane p{static_cast<float>(g[0]), static_cast<float>(g[1]), static_cast<float>(g[2]), 0};
  if (!normalise(p)) p = {0, 0, 1, 0};
  p.d = (static_cast<float>(grid.count(id)) / 64 - 0.5f) *
        std::max({std::abs(p.nx), std::abs(p.ny), std::abs(p.nz)});
  return p;
}

/// Plane through the heights of the nine columns along an axis, if each goes from soil to air
/// within two cells on both sides.
bool by_heights(const CellGrid& grid, int id, int axis, bool up, CellPlane& plane) {
  const int step = up ? grid.step(axis) : -grid.step(axis);
  const int u = grid.step((axis + 1) % 3), v = grid.step((axis + 2) % 3);
  int all = 0, along_u = 0, along_v = 0;
  for (int i = -1; i <= 1; ++i) {
    for (int j = -1; j <= 1; ++j) {
      const int middle = id + i * u + j * v;
      // Out from the middle to a full cell below and an empty one above.
      int k = 0, height = 0;
      for (int n = 64; n != 0; --k) {
        if (k < -kHeightFitReach) return false;
        n = 64 - grid.count(middle + k * step);
        height -= n;
      }
      for (k = 1; k <= kHeightFitReach; ++k) {
        const int n = grid.count(middle + k * step);
        height += n;
        if (n == 0) break;
      }
      if (k > kHeightFitReach) return false;
      all += height;
      along_u += i * height;
      along_v += j * height;
    }
  }
  // Heights are above the top of the middle cell.
  float n[3];
  n[axis] = up ? 1.0f : -1.0f;
  n[(axis + 1) % 3] = -static_cast<float>(along_u) / (6 * 64);
  n[(axis + 2) % 3] = -static_cast<float>(along_v) / (6 * 64);
  plane = {n[0], n[1], n[2], 0.5f + static_cast<float>(all) / (9 * 64)};
  return normalise(plane);
}

SOILVDB_FOR_CPUS void refine(const CellGrid& grid, int id, PlaneFit& fit) {
  Residual r;
  for (int k = 0; k < kFitSteps; ++k) {
    const Tangents t(fit.plane);
    evaluate(grid, id, fit.plane, t, false, r);
    const float share = static_cast<float>(r.wrong) / (64 * r.area);
    fit.smooth = k > 0 && share <= kSmoothWrongShare && r.most <= kSmoothWrongInCell;
    if (k > 0 && share > kHopelessWrongShare) return;
    if (k + 1 == kFitSteps && !fit.smooth) return;
    improve(r, t, fit.plane);
    if (fit.smooth) return;
  }
}

SOILVDB_FOR_CPUS void refine_one_side(const CellGrid& grid, int id, PlaneFit& fit) {
  Residual r;
  for (int k = 0;; ++k) {
    const Tangents t(fit.plane);
    evaluate(grid, id, fit.plane, t, true, r);
    if (k == kFitSteps) {
      fit.one_sided = r.area >= kMinSideFitArea &&
                      static_cast<float>(r.wrong) <= kSmoothWrongShare * 64 * r.area;
      return;
    }
    improve(r, t, fit.plane);
  }
}

/// The axis along which there is air on both sides within two voxels and half a cell of soil, or of
/// two that share a face, between; or the same with air and soil swapped; -1.
int thin_axis(const CellGrid& grid, int id) {
  for (int axis = 0; axis < 3; ++axis) {
    const int step = grid.step(axis);
    const int below = grid.count(id - 2 * step), above = grid.count(id + 2 * step);
    const int a = grid.count(id - step), b = grid.count(id), c = grid.count(id + step);
    const auto [least, most] = std::minmax({2 * a, a + b, 2 * b, b + c, 2 * c});
    if (below < kThinWallOutside && above < kThinWallOutside && most >= kThinWallInside)
      return axis;
    if (below > 64 - kThinWallOutside && above > 64 - kThinWallOutside &&
        least <= 128 - kThinWallInside)
      return axis;
  }
  return -1;
}

/// A face across an axis of a wall or slot that fills the cell, placed by the counts.
CellPlane face_across(const CellGrid& grid, int id, int axis, int side) {
  const int beyond = grid.count(id + side * grid.step(axis));
  const bool wall = grid.count(id) > 32;
  float n[3] = {0, 0, 0};
  n[axis] = static_cast<float>(wall ? side : -side);
  return {n[0], n[1], n[2],
          wall ? 0.5f + static_cast<float>(beyond) / 64 : -1.5f + static_cast<float>(beyond) / 64};
}

}  // namespace

Tangents::Tangents(const CellPlane& p) {
  const float sign = p.nz < 0 ? -1.0f : 1.0f;
  const float a = -1 / (sign + p.nz), b = p.nx * p.ny * a;
  u[0] = 1 + sign * p.nx * p.nx * a;
  u[1] = sign * b;
  u[2] = -sign * p.nx;
  v[0] = b;
  v[1] = sign + p.ny * p.ny * a;
  v[2] = -p.ny;
}

void displace(CellPlane& plane, const Tangents& t, const float* a, const float* b, float most) {
  const float c00 = a[3] * a[5] - a[4] * a[4], c01 = a[2] * a[4] - a[1] * a[5],
              c02 = a[1] * a[4] - a[2] * a[3];
  const float det = a[0] * c00 + (a[1] * c01 + a[2] * c02);
  if (!(det > kMinFitDeterminant)) return;
  const float c11 = a[0] * a[5] - a[2] * a[2], c12 = a[1] * a[2] - a[0] * a[4],
              c22 = a[0] * a[3] - a[1] * a[1];
  const float scale = 1 / (64 * det);
  const auto held = [&](float v) { return std::min(std::max(v * scale, -most), most); };
  const float shift = held(c00 * b[0] + (c01 * b[1] + c02 * b[2]));
  const float tilt_u = held(c01 * b[0] + (c11 * b[1] + c12 * b[2]));
  const float tilt_v = held(c02 * b[0] + (c12 * b[1] + c22 * b[2]));
  const float norm = 1 / std::sqrt(1 + (tilt_u * tilt_u + tilt_v * tilt_v));
  plane.nx = (plane.nx - (tilt_u * t.u[0] + tilt_v * t.v[0])) * norm;
  plane.ny = (plane.ny - (tilt_u * t.u[1] + tilt_v * t.v[1])) * norm;
  plane.nz = (plane.nz - (tilt_u * t.u[2] + tilt_v * t.v[2])) * norm;
  plane.d = (plane.d + shift) * norm;
}

PlaneFit fit_plane(const CellGrid& grid, int id) {
  PlaneFit fit;
  const CellPlane start = by_gradient(grid, id);
  const float n[3] = {start.nx, start.ny, start.nz};
  int axis = 0;
  for (int a = 1; a < 3; ++a) {
    if (std::abs(n[a]) > std::abs(n[axis])) axis = a;
  }
  fit.plane = start;
  by_heights(grid, id, axis, n[axis] > 0, fit.plane);
  refine(grid, id, fit);
  const int across = fit.smooth ? -1 : thin_axis(grid, id);
  if (across < 0) return fit;
  PlaneFit side;
  side.plane = start;
  refine_one_side(grid, id, side);
  if (side.one_sided) return side;
  PlaneFit other;  // the gradient is useless if both sides are alike
  side.plane = face_across(grid, id, across, 1);
  other.plane = face_across(grid, id, across, -1);
  refine_one_side(grid, id, side);
  refine_one_side(grid, id, other);
  if (!side.one_sided || !other.one_sided) return fit;
  side.opposite = other.plane;
  side.has_opposite = true;
  return side;
}

}  // namespace soilvdb::inline v0
