// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/ground/bilinear_patch.h"

#include <algorithm>
#include <cmath>

#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/lattice/lanes.h"

namespace soilvdb::inline v0 {
namespace {

/// A patch relative to the foot of the points. Only small differences remain, so float is enough.
/// (u, v) are fractions of the patch's sides from the foot.
struct PatchSeen {
  float dx, dy;            // sides
  float rx, ry, rz, step;  // from the first point to the foot; step to the next point
  float su, sv, twist;     // dz/du, dz/dv at the foot, d2z/dudv
  float u_low, u_high, v_low, v_high;
  float gap;    // height of the first point above the ground; NaN: unknown
  float aside;  // horizontal distance to the patch
  float slope;
};

/// May the patch be nearer than `best`? At a horizontal distance r the field is at least gap -
/// slope r above or below a point.
SOILVDB_INLINE bool may_be_nearer(const PatchSeen& s, Lanes best2) {
  const Lanes gap = abs(s.gap + kLaneNumbers * s.step);
  const Lanes r = max(gap * (s.slope / (1 + s.slope * s.slope)), all_lanes(s.aside));
  const Lanes dz = max(gap - s.slope * r, all_lanes(0));
  return bits(r * r + dz * dz < best2) != 0;
}

SOILVDB_FOR_CPUS void nearest(const PatchSeen& s, float* best) {
  Lanes least;
  for (int k = 0; k < kChunkSide; ++k) least[k] = best[k] * best[k];
  if (s.aside > 0 && !may_be_nearer(s, least)) return;
  const Lanes rz0 = s.rz - kLaneNumbers * s.step;
  const Lanes u_low = all_lanes(s.u_low), u_high = all_lanes(s.u_high);
  const Lanes v_low = all_lanes(s.v_low), v_high = all_lanes(s.v_high);
  float farthest = 0;
  for (int k = 0; k < kChunkSide; ++k) farthest = std::max(farthest, best[k]);
  const bool twisted = std::abs(s.twist) * farthest > kTwistedPatch * s.dx * s.dy;
  const int iterations = twisted ? kTwistedPatchSteps : kPatchSteps;
  Lanes u = {}, v = {};
  for (int i = 0;; ++i) {
    const Lanes su = s.su + v * s.twist, sv = s.sv + u * s.twist;
    const Lanes rx = s.rx + u * s.dx, ry = s.ry + v * s.dy, rz = rz0 + u * s.su + v * sv;
    least = min(least, rx * rx + ry * ry + rz * rz);
    if (i == iterations) break;
    const Lanes a = s.dx * s.dx + su * su, b = su * sv, c = s.dy * s.dy + sv * sv;
    const Lanes gu = s.dx * rx + su * rz, gv = s.dy * ry + sv * rz;
    const Lanes by_det = 1 / (a * c - b * b);
    const Lanes full_u = u - (c * gu - b * gv) * by_det, full_v = v - (a * gv - b * gu) * by_det;
    const Lanes held_u = min(max(full_u, u_low), u_high), held_v = min(max(full_v, v_low), v_high);
    // On a border the other coordinate may still move along it.
    const Lanes along_v = min(max(v - (gv + b * (held_u - u)) / c, v_low), v_high);
    const Lanes along_u = min(max(u - (gu + b * (held_v - v)) / a, u_low), u_high);
    const LaneMask on_u = held_u != full_u, on_v = held_v != full_v;
    v = on_u ? along_v : held_v;
    u = on_v & ~on_u ? along_u : held_u;
  }
  least = sqrt(least);
  for (int k = 0; k < kChunkSide; ++k) best[k] = least[k];
}

SOILVDB_FOR_CPUS void below(const CellPoints& p, float a, float b, float c, float d,
                            std::uint32_t* half) {
  for (int g = 0; g < 2; ++g) {
    std::uint32_t bits = 0;
    for (int i = 0; i < 32; ++i) {
      const int n = g * 32 + i;
      const bool in = p.z[n] < a + b * p.x[n] + (c + d * p.x[n]) * p.y[n];
      bits |= in ? kBits.bit[i] : 0u;
    }
    half[g] = bits;
  }
}

}  // namespace

void nearest_on_patch(const BilinearPatch& patch, double x0, double y0, const PointRow& row,
                      std::array<float, kChunkSide>& best) {
  const double x = row.x - x0, y = row.y - y0;
  const double u = std::clamp(x / patch.dx, 0.0, 1.0), v = std::clamp(y / patch.dy, 0.0, 1.0);
  const double zu = patch.z10 - patch.z00, zv = patch.z01 - patch.z00;
  const double twist = patch.z00 - patch.z10 - patch.z01 + patch.z11;
  PatchSeen s;
  s.dx = static_cast<float>(patch.dx);
  s.dy = static_cast<float>(patch.dy);
  s.rx = static_cast<float>(u * patch.dx - x);
  s.ry = static_cast<float>(v * patch.dy - y);
  s.rz = static_cast<float>(patch.z00 + u * zu + v * zv + u * v * twist - row.z);
  s.step = static_cast<float>(row.step);
  s.su = static_cast<float>(zu + v * twist);
  s.sv = static_cast<float>(zv + u * twist);
  s.twist = static_cast<float>(twist);
  s.u_low = static_cast<float>(-u);
  s.u_high = static_cast<float>(1 - u);
  s.v_low = static_cast<float>(-v);
  s.v_high = static_cast<float>(1 - v);
  s.gap = static_cast<float>(row.z - row.ground);
  s.aside = std::isnan(row.ground) ? 0 : std::hypot(s.rx, s.ry);
  s.slope = static_cast<float>(row.slope);
  nearest(s, best.data());
}

std::uint64_t points_below(const CellPoints& points, float a, float b, float c, float d) {
  std::uint32_t half[2];
  below(points, a, b, c, d, half);
  return std::uint64_t{half[1]} << 32 | half[0];
}

}  // namespace soilvdb::inline v0
