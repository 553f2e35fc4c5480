// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface/surface.h"

#include <tbb/parallel_for.h>

#include <map>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {
namespace {

constexpr int kChunksPerBlock = kBlockSide / kChunkSide;

int halo(SurfaceBlock::Need need) { return need == SurfaceBlock::kMesh ? 1 : 2; }

/// Is a chunk beyond the band around resident ground?
bool untouched_around(const Ground& ground, const Coord3& chunk) {
  for (int n = 0; n < 27; ++n) {
    if (ground.find(chunk + kChunkSide * step_around(n)) != nullptr) return false;
  }
  return true;
}

void base_distance(const Ground& ground, const Coord3& chunk, float* phi_m) {
  ground.terrain().distance(ground.world_from_index(chunk.cast<double>()), ground.voxel_size_m(),
                            ground.band_m(), phi_m);
}

}  // namespace

SurfaceBlock::SurfaceBlock(const Ground& ground, std::span<const Coord3> chunks, Need need,
                           FitCache* cache)
    : grid_(ground, chunks, halo(need)),
      models_(grid_, need == kMesh ? 1 : kPolygonsSeen + 1, cache),
      contour_(soilvdb::contour(models_, need == kMesh ? 0 : kPolygonsSeen + 1)) {
  if (need == kDistance) distance_.emplace(ground, models_, contour_);
}

void surface_distance(const Ground& ground, const Coord3& chunk_origin, float* phi_m) {
  if (untouched_around(ground, chunk_origin)) return base_distance(ground, chunk_origin, phi_m);
  SurfaceBlock(ground, {&chunk_origin, 1}, SurfaceBlock::kDistance).distance(chunk_origin, phi_m);
}

void surface_distances(const Ground& ground, std::span<const Coord3> chunks,
                       const std::function<void(std::size_t, const float*)>& out) {
  struct Piece {
    std::vector<Coord3> chunks;
    std::vector<std::size_t> numbers;
  };
  std::map<Coord3, Piece, Before> by_block;
  std::vector<std::size_t> untouched;
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    const Coord3& c = chunks[i];
    if (untouched_around(ground, c)) {
      untouched.push_back(i);
      continue;
    }
    Piece& piece = by_block[floor_to(c, kSharedSide)];
    piece.chunks.push_back(c);
    piece.numbers.push_back(i);
  }
  tbb::parallel_for(std::size_t{0}, untouched.size(), [&](std::size_t i) {
    float phi_m[kChunkVoxels];
    base_distance(ground, chunks[untouched[i]], phi_m);
    out(untouched[i], phi_m);
  });
  std::vector<const Piece*> pieces;
  for (const auto& [block, piece] : by_block) pieces.push_back(&piece);
  tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t i) {
    const Piece& piece = *pieces[i];
    const SurfaceBlock block(ground, piece.chunks, SurfaceBlock::kDistance);
    float phi_m[kChunkVoxels];
    for (std::size_t k = 0; k < piece.chunks.size(); ++k) {
      block.distance(piece.chunks[k], phi_m);
      out(piece.numbers[k], phi_m);
    }
  });
}

std::vector<Coord3> resident_chunks(const Ground& ground, const Coord3& block) {
  std::vector<Coord3> all;
  for (int n = 0; n < kChunksPerBlock * kChunksPerBlock * kChunksPerBlock; ++n) {
    const Coord3 origin = block + kChunkSide * Coord3(n / 16, n / 4 % 4, n % 4);
    if (ground.find(origin) != nullptr) all.push_back(origin);
  }
  return all;
}

}  // namespace soilvdb::inline v0
