// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Eight floats at once, one for each voxel of a row; compiled to the vectors of the CPU.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {

using Lanes = float __attribute__((vector_size(kChunkSide * sizeof(float))));
/// A lane has all bits set or no bit, the result of comparing Lanes.
using LaneMask = std::int32_t __attribute__((vector_size(kChunkSide * sizeof(std::int32_t))));

/// For every function or lambda that takes or returns vectors: kernels for newer CPUs pass them in
/// other registers than code for any CPU does.
#define SOILVDB_INLINE inline __attribute__((always_inline))

inline constexpr Lanes kLaneNumbers = {0, 1, 2, 3, 4, 5, 6, 7};

SOILVDB_INLINE Lanes all_lanes(float v) { return Lanes{} + v; }
SOILVDB_INLINE Lanes min(Lanes a, Lanes b) { return a < b ? a : b; }
SOILVDB_INLINE Lanes max(Lanes a, Lanes b) { return a > b ? a : b; }
SOILVDB_INLINE Lanes abs(Lanes v) {
  return reinterpret_cast<Lanes>(reinterpret_cast<LaneMask>(v) & 0x7fffffff);
}
SOILVDB_INLINE Lanes sqrt(Lanes v) {
  Lanes root;
  for (int k = 0; k < kChunkSide; ++k) root[k] = std::sqrt(v[k]);
  return root;
}

SOILVDB_INLINE Lanes lanes_at(const float* from) {
  Lanes v;
  __builtin_memcpy(&v, from, sizeof(v));
  return v;
}
SOILVDB_INLINE float largest(Lanes v) {
  float most = v[0];
  for (int k = 1; k < kChunkSide; ++k) most = std::max(most, v[k]);
  return most;
}

/// Bit k is set where lane k is.
SOILVDB_INLINE std::uint32_t bits(LaneMask mask) {
  using Quarters = std::uint64_t __attribute__((vector_size(sizeof(LaneMask))));
  constexpr LaneMask kBit = {1, 2, 4, 8, 16, 32, 64, 128};
  const Quarters q = reinterpret_cast<Quarters>(mask & kBit);
  const std::uint64_t any = q[0] | q[1] | q[2] | q[3];
  return static_cast<std::uint32_t>(any | any >> 32);
}

}  // namespace soilvdb::inline v0
