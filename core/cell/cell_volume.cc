// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cell/cell_volume.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/cell/plane_mask.h"
#include "core/constants.h"
#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {
namespace {

/// Below one plane: the pyramid of the cut corner minus those beyond the cell (Scardovelli and
/// Zaleski 2000), in pairs, so that normals along an axis are safe.
CellVolume below_plane(const CellPlane& p) {
  double a = std::max(std::abs(double{p.nx}), kMinVolumeNormal),
         b = std::max(std::abs(double{p.ny}), kMinVolumeNormal),
         c = std::max(std::abs(double{p.nz}), kMinVolumeNormal);
  if (a > b) std::swap(a, b);
  if (a > c) std::swap(a, c);
  const double depth = (a + b + c) / 2 - std::abs(double{p.d});
  double volume = 0, area = 0;
  const auto add = [&](double x, double sign) {
    if (x <= 0) return;
    volume += sign * (x < a ? x * x * x / a : 3 * x * (x - a) + a * a);
    area += sign * (x < a ? 3 * x * x / a : 6 * x - 3 * a);
  };
  add(depth, 1);
  add(depth - b, -1);
  add(depth - c, -1);
  const double share = 1 / (6 * b * c);
  volume *= share;
  return {static_cast<float>(p.d > 0 ? 1 - volume : volume), static_cast<float>(area * share)};
}

SOILVDB_INLINE Lanes signed_distance(const CellPlane& p, Lanes x, Lanes y, Lanes z) {
  const float d = p.d + (p.nx + p.ny + p.nz) / 2;
  return p.nx * x + (p.ny * y + p.nz * z) - d;
}

SOILVDB_FOR_CPUS CellVolume weighed(const CellModel& model, const Coord3& voxel) {
  const int planes = model.planes();
  const bool first_and = model.op == BooleanOp::kAnd || model.op == BooleanOp::kAndAnd ||
                         model.op == BooleanOp::kAndOr;
  const bool second_and = model.op == BooleanOp::kAndAnd || model.op == BooleanOp::kOrAnd;
  const int own = sample_pattern(voxel);
  Lanes volume = {}, area = {};
  for (int k = 0; k < kVolumePatterns; ++k) {
    const CellPoints& points =
        pattern_points((own + k * (kPatterns / kVolumePatterns)) % kPatterns);
    for (int row = 0; row < kChunkSide; ++row) {
      const int at = kChunkSide * row;
      const Lanes x = lanes_at(points.x + at), y = lanes_at(points.y + at),
                  z = lanes_at(points.z + at);
      Lanes s = signed_distance(model.plane[0], x, y, z);
      const Lanes b = signed_distance(model.plane[1], x, y, z);
      s = first_and ? max(s, b) : min(s, b);
      if (planes > 2) {
        const Lanes c = signed_distance(model.plane[2], x, y, z);
        s = second_and ? max(s, c) : min(s, c);
      }
      const Lanes share = 0.5f - s / (2 * kVolumeSoftness);
      volume += min(max(share, all_lanes(0)), all_lanes(1));
      area += (share > 0.0f && share < 1.0f) ? all_lanes(1) : all_lanes(0);
    }
  }
  float soil = 0, near = 0;
  for (int lane = 0; lane < kChunkSide; ++lane) {
    soil += volume[lane];
    near += area[lane];
  }
  constexpr float kShare = 1.0f / (64 * kVolumePatterns);
  return {soil * kShare, near * (kShare / (2 * kVolumeSoftness))};
}

}  // namespace

CellVolume cell_volume(const CellModel& model, const Coord3& voxel) {
  return model.op == BooleanOp::kOne ? below_plane(model.plane[0]) : weighed(model, voxel);
}

}  // namespace soilvdb::inline v0
