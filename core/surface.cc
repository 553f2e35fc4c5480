// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface.h"

namespace soilvdb {
namespace {

constexpr int kChunksPerBlock = kBlockSide / kLeafSide;

/// Voxels around a chunk in which pieces of the surface may be the nearest: the band and a polygon's.
constexpr int kSeen = 4;

int halo(SurfaceBlock::Need need) { return need == SurfaceBlock::kMesh ? 1 : 2; }

}  // namespace

SurfaceBlock::SurfaceBlock(const Soil& soil, const Coord3& block, std::span<const Coord3> chunks,
                           Need need)
    : soil_(soil),
      grid_(soil, block - Coord3::Constant(kLeafSide * halo(need)),
            kBlockSide + 2 * kLeafSide * halo(need), chunks, halo(need)),
      models_(grid_, need == kMesh ? 1 : kSeen + 1),
      contour_(soilvdb::contour(models_, need == kMesh ? 0 : kSeen)) {}

std::vector<Coord3> resident_chunks(const Soil& soil, const Coord3& block) {
  std::vector<Coord3> all;
  for (int n = 0; n < kChunksPerBlock * kChunksPerBlock * kChunksPerBlock; ++n) {
    const Coord3 origin = block + kLeafSide * Coord3(n / 16, n / 4 % 4, n % 4);
    if (soil.find(origin) != nullptr) all.push_back(origin);
  }
  return all;
}

}  // namespace soilvdb
