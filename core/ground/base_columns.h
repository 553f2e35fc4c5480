// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the initial terrain has over columns of chunks: asked for once, looked at many times.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <vector>

#include "core/constants.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// The initial terrain over one column of chunks, index space.
struct BaseColumn {
  static constexpr int kCells = kChunkSide * kChunkSide;

  bool some = false;  ///< there is ground
  int highest = 0;    ///< z of the highest chunk that may hold some of it
  bool whole = true;  ///< there is ground everywhere
  /// Bit x * 8 + y: there is ground all over that column of cells. Where it ends within, no cell
  /// would ever be full.
  std::uint64_t all_ground = ~std::uint64_t{0};
  /// Mean heights over columns of cells, nearly what counts will find: that in the middle is a cell
  /// off beside cliffs. NaN where there is none.
  std::array<double, kCells> heights;
};

/// Samples of the initial terrain in the chunks of one tile. It keeps its memory for the next.
class TerrainChunks {
 public:
  /// Looked at as Samples are, but these allocate.
  struct Chunk {
    int z = 0;
    std::array<std::uint64_t, kChunkSide> some{}, full{};  ///< bits of the cells of each 64
    SampleWords words;

    std::uint32_t any_of_row(int first) const { return row(some, first); }
    std::uint32_t full_of_row(int first) const { return row(full, first); }
    std::uint64_t word(int n) const { return words[static_cast<std::size_t>(n)]; }

   private:
    static std::uint32_t row(const std::array<std::uint64_t, kChunkSide>& bits, int first) {
      return bits[static_cast<std::size_t>(first >> 6)] >> (first & 63) & 0xff;
    }
  };

  /// Keeps what it has of the same tile. @param most its chunks; the memory for them is got now
  void begin(const Coord2& tile, int most) {
    if (tile != tile_) chunks_.clear();
    tile_ = tile;
    was_read_ = false;
    chunks_.reserve(static_cast<std::size_t>(std::clamp(most, 0, kMostAtOnce)));
  }
  bool was_read() const { return was_read_; }  ///< since begin()
  /// Valid until the next call.
  const Chunk& read(const Ground& ground, const Coord3& origin);

 private:
  static constexpr int kMostAtOnce = 256;  // 1 MB; of higher cliffs as they are read

  Coord2 tile_ = {0, 0};
  bool was_read_ = false;
  std::vector<Chunk> chunks_;
};

/// Keeps what was asked for, up to kMaxBaseColumns. Not for several threads; but those of clones
/// may be used at once, and tell each other.
class BaseColumns {
 public:
  /// @param ground outlives it
  explicit BaseColumns(const Ground& ground) : ground_(ground), told_(std::make_shared<Told>()) {}
  /// @param ground one with the initial terrain, voxel size and origin of the other's
  BaseColumns(const Ground& ground, const BaseColumns& other)
      : ground_(ground), told_(other.told_) {}

  const Ground& ground() const { return ground_; }
  /// @param cx, cy the chunks' lowest cell; valid until the next call
  const BaseColumn& at(int cx, int cy) { return *known(cx, cy).column; }
  /// May the terrain's surface be in a chunk? Looked up once, if it is not far from the highest.
  bool is_mixed(const Coord3& chunk);
  /// So many more will be kept together, up to kMaxBaseColumns.
  void make_room(std::size_t more) {
    if (columns_.size() + more > kMaxBaseColumns) columns_.clear();
  }
  /// Mean height over a column of cells, index space; NaN where there is none.
  double height(const Eigen::Vector2i& cell);
  /// For readers of one tile at a time.
  TerrainChunks& chunks() { return chunks_; }

 private:
  using Columns = std::unordered_map<std::uint64_t, std::shared_ptr<const BaseColumn>>;
  struct Known {
    std::shared_ptr<const BaseColumn> column;
    std::uint64_t looked_up = 0, mixed = 0;  // bits of chunks about the highest
  };
  Known& known(int cx, int cy);
  /// What all clones asked for.
  struct Told {
    std::mutex mutex;
    Columns columns;
  };
  std::shared_ptr<const BaseColumn> ask(std::uint64_t key, int cx, int cy);

  const Ground& ground_;
  std::unordered_map<std::uint64_t, Known> columns_;  // at hand without a lock
  TerrainChunks chunks_;
  std::shared_ptr<Told> told_;
};

}  // namespace soilvdb::inline v0
