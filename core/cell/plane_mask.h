// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Which samples of a cell lie below a plane: the kernel of all fits.
#pragma once

#include <cstdint>

#include "core/cell/cell_plane.h"
#include "core/cell/cell_samples.h"
#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/lattice/lanes.h"

namespace soilvdb::inline v0 {

/// Which samples of the cell a plane has in soil. `d` is from that cell's centre.
SOILVDB_INLINE std::uint64_t plane_mask(const CellSamples& samples, const CellPlane& p) {
  const CellPoints& points = samples.columns;
  const Lanes nx = all_lanes(p.nx), ny = all_lanes(p.ny), nz = all_lanes(p.nz);
  const Lanes d = all_lanes(p.d + (p.nx + p.ny + p.nz) / 2);
  LaneMask rows = {};
  for (int k = 0; k < kChunkSide; ++k) {
    Lanes x, y, z;
    __builtin_memcpy(&x, points.x + kChunkSide * k, sizeof(x));
    __builtin_memcpy(&y, points.y + kChunkSide * k, sizeof(y));
    __builtin_memcpy(&z, points.z + kChunkSide * k, sizeof(z));
    rows |= (nx * x + (ny * y + nz * z) < d) & (1 << k);
  }
  // Bit k of lane j is point 8 j + k.
  using Bytes = std::uint8_t __attribute__((vector_size(kChunkSide)));
  const Bytes bytes = __builtin_convertvector(rows, Bytes);
  std::uint64_t word;
  __builtin_memcpy(&word, &bytes, sizeof(word));
  return word;
}

}  // namespace soilvdb::inline v0
