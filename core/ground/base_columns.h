// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the initial terrain has over columns of chunks: asked for once, looked at many times.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <unordered_map>

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
  const BaseColumn& at(int cx, int cy);
  /// Mean height over a column of cells, index space; NaN where there is none.
  double height(const Eigen::Vector2i& cell);

 private:
  using Columns = std::unordered_map<std::uint64_t, std::shared_ptr<const BaseColumn>>;
  /// What all clones asked for.
  struct Told {
    std::mutex mutex;
    Columns columns;
  };
  std::shared_ptr<const BaseColumn> ask(std::uint64_t key, int cx, int cy);

  const Ground& ground_;
  Columns columns_;  // at hand without a lock
  std::shared_ptr<Told> told_;
};

}  // namespace soilvdb::inline v0
