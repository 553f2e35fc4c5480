// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What ground that was dug shows to ground with other voxels, kept by blocks.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "soilvdb/chunk_range.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Distances and changes at the voxels of ground that nobody digs any more. A block of 32 voxels a
/// side is made when somebody first asks for it, and kept as long as there is room.
///
/// Invariant: values depend on the ground alone, not on what was asked for, forgotten or dropped
/// before. All members are safe to call from several threads, but for forget().
class GroundTiles {
 public:
  /// One chunk. Bit z of byte x * 8 + y stands for voxel x * 64 + y * 8 + z.
  struct Tile {
    float distance_m[kChunkVoxels];                   ///< surface_distance()
    std::uint8_t changed[kChunkSide * kChunkSide];    ///< the samples aren't the base surface's
    std::uint8_t different[kChunkSide * kChunkSide];  ///< the distance isn't the base surface's
  };
  /// The chunks of a block that are resident or have one around that is.
  struct Block {
    std::array<std::int8_t, 64> place;  ///< in `tiles`, by chunk; -1: not there
    std::vector<Tile> tiles;
  };

  /// @param ground outlives it, and doesn't change
  explicit GroundTiles(const Ground& ground);

  /// @param origin multiples of 32
  std::shared_ptr<const Block> block(const Coord3& origin) const;

  /// What it holds of memory.
  std::uint64_t bytes() const;
  /// Gives all of it back. Runs beside nothing.
  void forget();

  /// For many look-ups near each other, by one thread.
  class Reader {
   public:
    explicit Reader(const GroundTiles& tiles) : tiles_(tiles) {}
    /// Null where no chunk around is resident. Good until the next call.
    const Tile* tile(const Coord3& chunk);

   private:
    struct Slot {
      Coord3 chunk;
      std::shared_ptr<const Block> block;  // null: nothing there yet
      const Tile* tile = nullptr;
    };
    const GroundTiles& tiles_;
    std::array<Slot, 8> slots_;
  };

 private:
  struct Entry {
    std::mutex mutex;  // held by who makes it
    std::shared_ptr<const Block> block;
  };
  std::shared_ptr<const Block> make(const Coord3& origin) const;
  void keep(const Coord3& origin, const std::shared_ptr<Entry>& entry) const;

  const Ground& ground_;
  std::uint64_t most_bytes_;
  mutable std::mutex mutex_;  // of what follows
  mutable std::map<Coord3, std::shared_ptr<Entry>, Before> entries_;
  mutable std::deque<Coord3> oldest_;  // of those that are made
  mutable std::uint64_t bytes_ = 0;
};

}  // namespace soilvdb::inline v0
