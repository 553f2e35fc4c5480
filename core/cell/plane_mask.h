// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The samples of a cell below a plane: the kernel of all fits.
#pragma once

#include <cstdint>

#include "core/cell/cell_plane.h"
#include "core/lattice/affine.h"
#include "core/lattice/lanes.h"

namespace soilvdb::inline v0 {

/// Rows to columns in a square of 8 x 8 bits (Warren, Hacker's Delight 7-3).
SOILVDB_INLINE std::uint64_t transpose(std::uint64_t b) {
  std::uint64_t t = (b ^ b >> 7) & 0x00aa00aa00aa00aau;
  b ^= t ^ t << 7;
  t = (b ^ b >> 14) & 0x0000cccc0000ccccu;
  b ^= t ^ t << 14;
  t = (b ^ b >> 28) & 0x00000000f0f0f0f0u;
  return b ^ t ^ t << 28;
}

/// Samples of the cell below a plane. `d` is relative to that cell's centre.
SOILVDB_INLINE std::uint64_t plane_mask(const CellPoints& points, const CellPlane& p) {
  const Lanes nx = all_lanes(p.nx), ny = all_lanes(p.ny), nz = all_lanes(p.nz);
  const Lanes d = all_lanes(p.d + (p.nx + p.ny + p.nz) / 2);
  LaneMask rows = {};
  for (int k = 0; k < kChunkSide; ++k) {
    const int at = kChunkSide * k;
    const Lanes x = lanes_at(points.x + at), y = lanes_at(points.y + at),
                z = lanes_at(points.z + at);
    rows |= (nx * x + (ny * y + nz * z) < d) & (1 << k);
  }
  // Bit k of lane j is point 8 k + j.
  using Bytes = std::uint8_t __attribute__((vector_size(kChunkSide)));
  const Bytes bytes = __builtin_convertvector(rows, Bytes);
  std::uint64_t square;
  __builtin_memcpy(&square, &bytes, sizeof(square));
  return transpose(square);
}

}  // namespace soilvdb::inline v0
