// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The sample words around some chunks in one array, for the stages that make surfaces.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/lattice/chunk_math.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// A box of cells with their words, the content of the initial terrain, and the requested chunks.
///
/// Invariants: the read chunks are the requested chunks and a fixed number of chunks around each,
/// for every box. Other cells are air and must not be used. A cell at most `range` voxels from a
/// requested chunk has all words around it that its results depend on.
///
/// For one thread at a time: some members are computed when first requested.
class CellGrid {
 public:
  /// The smallest box around the read chunks.
  /// @param asked requested chunks, at least one
  /// @param halo chunks read around each of them
  CellGrid(const Ground& ground, std::span<const Coord3> asked, int halo);
  ~CellGrid();
  CellGrid(const CellGrid&) = delete;
  CellGrid& operator=(const CellGrid&) = delete;

  const Coord3& sides() const { return sides_; }
  /// Number of cells; ids begin with 0.
  std::size_t cells() const { return cells_; }
  const Coord3& first() const { return first_; }
  int id(int x, int y, int z) const { return (x * sides_.y() + y) * sides_.z() + z; }
  Coord3 at(int id) const { return {id / step(0), id / sides_.z() % sides_.y(), id % sides_.z()}; }
  /// Steps of ids along the axes.
  int step(int axis) const {
    return axis == 0 ? sides_.y() * sides_.z() : axis == 1 ? sides_.z() : 1;
  }

  /// The cell at a step_around() from a cell.
  int beside(int id, int n) const {
    const Coord3 by = step_around(n);
    return id + by.x() * step(0) + by.y() * step(1) + by.z();
  }

  const std::uint64_t* words() const { return words_; }
  std::uint64_t word(int id) const { return words_[id]; }
  /// Samples of soil.
  int count(int id) const { return counts_[id]; }
  const std::uint8_t* counts() const { return counts_; }
  /// True if the words of a cell and of the 26 around it are those of the initial terrain.
  bool undug(int id) const;
  /// Whether the chunk of a cell is requested, and whether it is resident.
  bool asked(const Coord3& cell) const { return asked_[chunk_of(cell)]; }
  bool resident(const Coord3& cell) const { return resident_[chunk_of(cell)]; }
  /// Voxels from a cell to the nearest requested chunk, which is at most two chunks away; 0 inside.
  int away(const Coord3& cell) const;
  /// True if a cell of a cube differs from the initial terrain. Cells beyond the grid do not.
  bool any_change(const Coord3& low, int side) const;
  const CellPoints& points(int id) const {
    std::uint8_t& pattern = buffers_->patterns[static_cast<std::size_t>(id)];
    if (pattern == kPatterns) pattern = static_cast<std::uint8_t>(sample_pattern(first_ + at(id)));
    return pattern_points(pattern);
  }

  /// The initial terrain's own distance at the centre of a cell, voxels, clamped to +-3.
  float base_distance(int id) const;

  /// Cells on the surface, in order: mixed cells, and full cells that share a face with an empty
  /// one. At most `range` from a requested chunk.
  struct Cell {
    int id;
    int away;  ///< voxels from the nearest requested chunk; 0 inside
  };
  std::vector<Cell> surface_cells(int range) const;

 private:
  enum State : std::uint8_t { kUnread, kEmpty, kFull, kBoth };
  int chunk_id(int x, int y, int z) const { return (x * chunks_.y() + y) * chunks_.z() + z; }
  std::size_t chunk_of(const Coord3& c) const {
    return static_cast<std::size_t>(
        chunk_id(c.x() / kChunkSide, c.y() / kChunkSide, c.z() / kChunkSide));
  }
  /// Low corners of the requested chunks at most two chunks from a chunk.
  const std::vector<Coord3>& asked_near(const Coord3& chunk) const;
  static int away(const Coord3& cell, const std::vector<Coord3>& asked);
  void read(const Ground& ground, int chunk, const Coord3& origin);

  const Ground& ground_;
  Coord3 first_;
  Coord3 sides_, chunks_;
  std::size_t cells_;
  /// Memory of a box, used again by the next box of the thread: fresh pages cost as much as fits.
  struct Buffers {
    std::unique_ptr<std::uint64_t[]> words;
    std::size_t room = 0;  // words
    std::vector<std::uint8_t> counts, changed, patterns;
  };
  static std::vector<std::unique_ptr<Buffers>>& buffer_pool();
  std::unique_ptr<Buffers> buffers_;
  std::uint64_t* words_;
  std::uint8_t *counts_, *changed_;
  std::vector<State> states_;                                             // of chunks
  std::vector<std::uint8_t> asked_, resident_;                            // of chunks
  mutable std::vector<std::unique_ptr<float[]>> base_;                    // of chunks, voxels
  mutable std::vector<std::unique_ptr<std::vector<Coord3>>> asked_near_;  // of chunks
};

}  // namespace soilvdb::inline v0
