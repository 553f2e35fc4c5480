// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The sample words around some chunks, side by side in one array, for the stages that make
// surfaces.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/lattice/chunk_math.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// A box of cells with their words, what the base surface has there, and which chunks were asked
/// for.
///
/// Invariants: what is read is the chunks asked for and a fixed number of chunks around each,
/// whatever the box; elsewhere cells are air and aren't to be looked at. A cell that is `range`
/// voxels or less from a chunk asked for has all the words around it that its results depend on.
///
/// For one thread at a time: some of it is made when first asked for.
class CellGrid {
 public:
  /// The smallest box that holds what is read.
  /// @param asked for: chunks, at least one
  /// @param halo chunks read around each of them
  CellGrid(const Ground& ground, std::span<const Coord3> asked, int halo);
  ~CellGrid();
  CellGrid(const CellGrid&) = delete;
  CellGrid& operator=(const CellGrid&) = delete;

  const Coord3& sides() const { return sides_; }
  /// How many cells there are; ids are from 0.
  std::size_t cells() const { return cells_; }
  const Coord3& first() const { return first_; }
  int id(int x, int y, int z) const { return (x * sides_.y() + y) * sides_.z() + z; }
  Coord3 at(int id) const { return {id / step(0), id / sides_.z() % sides_.y(), id % sides_.z()}; }
  /// Steps of ids along the axes.
  int step(int axis) const {
    return axis == 0 ? sides_.y() * sides_.z() : axis == 1 ? sides_.z() : 1;
  }

  /// The cell a step_around() from one.
  int beside(int id, int n) const {
    const Coord3 by = step_around(n);
    return id + by.x() * step(0) + by.y() * step(1) + by.z();
  }

  const std::uint64_t* words() const { return words_; }
  std::uint64_t word(int id) const { return words_[id]; }
  /// Samples of soil.
  int count(int id) const { return counts_[id]; }
  const std::uint8_t* counts() const { return counts_; }
  /// Are the words of a cell and of the 26 around it those of the base surface?
  bool undug(int id) const;
  /// Is the chunk of a cell one of those asked for, is it resident?
  bool asked(const Coord3& cell) const { return asked_[chunk_of(cell)]; }
  bool resident(const Coord3& cell) const { return resident_[chunk_of(cell)]; }
  /// Voxels from a cell to the nearest chunk asked for that is no farther than two chunks; 0
  /// inside.
  int away(const Coord3& cell) const;
  /// Does any cell of a cube differ from the base surface? Cells beyond the grid don't.
  bool any_change(const Coord3& low, int side) const;
  const CellPoints& points(int id) const {
    std::uint8_t& pattern = buffers_->patterns[static_cast<std::size_t>(id)];
    if (pattern == kPatterns) pattern = static_cast<std::uint8_t>(sample_pattern(first_ + at(id)));
    return pattern_points(pattern);
  }

  /// The base surface's own distance at the centre of a cell, voxels, clamped to +-3.
  float base_distance(int id) const;

  /// Cells the surface runs through, in order: some samples are soil but not all, or all are and a
  /// cell that shares a face has none. No farther than `range` from a chunk asked for.
  struct Cell {
    int id;
    int away;  ///< voxels from the nearest chunk asked for; 0 inside
  };
  std::vector<Cell> surface_cells(int range) const;

 private:
  enum State : std::uint8_t { kUnread, kEmpty, kFull, kBoth };
  int chunk_id(int x, int y, int z) const { return (x * chunks_.y() + y) * chunks_.z() + z; }
  std::size_t chunk_of(const Coord3& c) const {
    return static_cast<std::size_t>(
        chunk_id(c.x() / kChunkSide, c.y() / kChunkSide, c.z() / kChunkSide));
  }
  /// Low corners of the chunks asked for that are no farther from one than two chunks.
  const std::vector<Coord3>& asked_near(const Coord3& chunk) const;
  static int away(const Coord3& cell, const std::vector<Coord3>& asked);
  void read(const Ground& ground, int chunk, const Coord3& origin);

  const Ground& ground_;
  Coord3 first_;
  Coord3 sides_, chunks_;
  std::size_t cells_;
  /// Memory of a box, used again by the next one of the thread: fresh pages cost as much as fits.
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
