// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Distances of a dug ground for a ground with another voxel size, kept by blocks.
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

/// Distances and changes at the voxels of a ground that does not change any more. A block of 32
/// voxels a side is made at its first request, and kept while there is room.
///
/// Invariant: values depend on the ground alone, not on earlier requests. Several threads may call
/// all members except forget().
class GroundTiles {
 public:
  /// One chunk. Bit z of byte x * 8 + y stands for voxel x * 64 + y * 8 + z.
  struct Tile {
    float distance_m[kChunkVoxels];                 ///< surface_distance()
    std::uint8_t changed[kChunkSide * kChunkSide];  ///< its samples differ from the initial terrain
    std::uint8_t
        different[kChunkSide * kChunkSide];  ///< its distance differs from the initial terrain
  };
  /// The chunks of a block that are resident or have a resident neighbour.
  struct Block {
    std::array<std::int8_t, 64> place;  ///< in `tiles`, by chunk; -1: absent
    std::vector<Tile> tiles;
  };

  /// @param ground must outlive it and not change
  explicit GroundTiles(const Ground& ground);

  /// @param origin multiples of 32
  std::shared_ptr<const Block> block(const Coord3& origin) const;

  /// Memory, bytes.
  std::uint64_t bytes() const;
  /// Frees all memory. Needs exclusive access.
  void forget();

  /// For many look-ups near each other, on one thread.
  class Reader {
   public:
    explicit Reader(const GroundTiles& tiles) : tiles_(tiles) {}
    /// Null if no chunk around is resident. Valid until the next call.
    const Tile* tile(const Coord3& chunk);

   private:
    struct Slot {
      Coord3 chunk;
      std::shared_ptr<const Block> block;  // null: no block yet
      const Tile* tile = nullptr;
    };
    const GroundTiles& tiles_;
    std::array<Slot, 8> slots_;
  };

 private:
  struct Entry {
    std::mutex mutex;  // held while it is made
    std::shared_ptr<const Block> block;
  };
  std::shared_ptr<const Block> make(const Coord3& origin) const;
  void keep(const Coord3& origin, const std::shared_ptr<Entry>& entry) const;

  const Ground& ground_;
  std::uint64_t most_bytes_;
  mutable std::mutex mutex_;  // for the members below
  mutable std::map<Coord3, std::shared_ptr<Entry>, Before> entries_;
  mutable std::deque<Coord3> oldest_;  // of the made blocks
  mutable std::uint64_t bytes_ = 0;
};

}  // namespace soilvdb::inline v0
