// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/lattice.h"

#include "core/constants.h"

namespace soilvdb::inline v0 {

Vec3 lattice_origin(double voxel_size_m, const Vec3& near_m) {
  const double step = kLatticePeriod * voxel_size_m;
  // Adding 0 turns -0 into 0.
  return (near_m.array() / step).round() * step + 0.0;
}

std::optional<Coord3> lattice_shift(const Ground& a, const Ground& b) {
  if (a.voxel_size_m() != b.voxel_size_m()) return std::nullopt;
  const Vec3 apart = (b.origin() - a.origin()) / (kLatticePeriod * a.voxel_size_m());
  const Vec3 periods = apart.array().round();
  if (!((apart - periods).cwiseAbs().maxCoeff() * kLatticePeriod < kLatticeTolerance) ||
      !(periods.cwiseAbs().maxCoeff() * kLatticePeriod < kMaxPlaceIndex))
    return std::nullopt;
  return Coord3((periods * kLatticePeriod).cast<int>());
}

}  // namespace soilvdb::inline v0
