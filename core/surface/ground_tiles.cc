// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface/ground_tiles.h"

#include <algorithm>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/surface.h"

namespace soilvdb::inline v0 {
namespace {

constexpr int kChunks = kBlockSide / kChunkSide;

std::size_t number(const Coord3& chunk) {
  return static_cast<std::size_t>(((chunk.x() / kChunkSide & (kChunks - 1)) * kChunks +
                                   (chunk.y() / kChunkSide & (kChunks - 1))) *
                                      kChunks +
                                  (chunk.z() / kChunkSide & (kChunks - 1)));
}

std::uint64_t bytes_of(const GroundTiles::Block& block) {
  return sizeof(block) + block.tiles.capacity() * sizeof(GroundTiles::Tile) +
         160;  // and its places
}

/// Bit z: a[z] != b[z].
template <typename T>
std::uint8_t unequal(const T* a, const T* b) {
  unsigned bits = 0;
  for (int z = 0; z < kChunkSide; ++z) bits |= static_cast<unsigned>(a[z] != b[z]) << z;
  return static_cast<std::uint8_t>(bits);
}

}  // namespace

GroundTiles::GroundTiles(const Ground& ground)
    : ground_(ground), most_bytes_(std::max(kMinTileBytes, ground.memory_bytes())) {}

std::shared_ptr<const GroundTiles::Block> GroundTiles::block(const Coord3& origin) const {
  std::shared_ptr<Entry> entry;
  {
    const std::lock_guard lock(mutex_);
    std::shared_ptr<Entry>& known = entries_[origin];
    if (!known) known = std::make_shared<Entry>();
    entry = known;
  }
  const std::lock_guard lock(entry->mutex);
  if (!entry->block) {
    entry->block = make(origin);
    keep(origin, entry);
  }
  return entry->block;
}

void GroundTiles::keep(const Coord3& origin, const std::shared_ptr<Entry>& entry) const {
  const std::lock_guard lock(mutex_);
  bytes_ += bytes_of(*entry->block);
  oldest_.push_back(origin);
  while (bytes_ > most_bytes_ && oldest_.size() > 1) {
    const auto drop = entries_.find(oldest_.front());
    bytes_ -= bytes_of(*drop->second->block);
    entries_.erase(drop);
    oldest_.pop_front();
  }
}

std::uint64_t GroundTiles::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

void GroundTiles::forget() {
  entries_.clear();
  oldest_.clear();
  bytes_ = 0;
}

/// On one thread: otherwise it could take up another reader's task that waits for this block.
std::shared_ptr<const GroundTiles::Block> GroundTiles::make(const Coord3& origin) const {
  bool near[kChunks + 4][kChunks + 4][kChunks + 4] = {};
  for (int x = 1; x <= kChunks + 2; ++x)
    for (int y = 1; y <= kChunks + 2; ++y)
      for (int z = 1; z <= kChunks + 2; ++z) {
        if (ground_.find(origin + kChunkSide * Coord3(x - 2, y - 2, z - 2)) == nullptr) continue;
        for (int n = 0; n < 27; ++n) {
          const Coord3 c = Coord3(x, y, z) + step_around(n);
          near[c.x()][c.y()][c.z()] = true;
        }
      }
  auto block = std::make_shared<Block>();
  block->place.fill(-1);
  std::vector<Coord3> chunks;
  for (int x = 0; x < kChunks; ++x)
    for (int y = 0; y < kChunks; ++y)
      for (int z = 0; z < kChunks; ++z)
        if (near[x + 2][y + 2][z + 2]) chunks.push_back(origin + kChunkSide * Coord3(x, y, z));
  if (chunks.empty()) return block;
  const SurfaceBlock surface(ground_, chunks, SurfaceBlock::kDistance);
  block->tiles.resize(chunks.size());
  SampleWords now, was;
  float base_m[kChunkVoxels];
  for (std::size_t k = 0; k < chunks.size(); ++k) {
    const Coord3& chunk = chunks[k];
    Tile& tile = block->tiles[k];
    block->place[number(chunk)] = static_cast<std::int8_t>(k);
    surface.distance(chunk, tile.distance_m);
    ground_.terrain().distance(ground_.world_from_index(chunk.cast<double>()),
                               ground_.voxel_size_m(), ground_.band_m(), base_m);
    for (int row = 0; row < kChunkSide * kChunkSide; ++row)
      tile.different[row] = unequal(tile.distance_m + row * kChunkSide, base_m + row * kChunkSide);
    if (ground_.find(chunk) == nullptr) continue;
    ground_.read_samples(chunk, now);
    ground_.read_base(chunk, was);
    for (int row = 0; row < kChunkSide * kChunkSide; ++row)
      tile.changed[row] = unequal(now.data() + row * kChunkSide, was.data() + row * kChunkSide);
  }
  return block;
}

const GroundTiles::Tile* GroundTiles::Reader::tile(const Coord3& chunk) {
  const Coord3 parity = chunk.unaryExpr([](int v) { return v / kChunkSide & 1; });
  Slot& slot = slots_[static_cast<std::size_t>(parity.x() * 4 + parity.y() * 2 + parity.z())];
  if (slot.block && slot.chunk == chunk) return slot.tile;
  slot.chunk = chunk;
  slot.block = tiles_.block(floor_to(chunk, kBlockSide));
  const int place = slot.block->place[number(chunk)];
  slot.tile = place < 0 ? nullptr : &slot.block->tiles[static_cast<std::size_t>(place)];
  return slot.tile;
}

}  // namespace soilvdb::inline v0
