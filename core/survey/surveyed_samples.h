// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where scans and surveys changed the ground: without it nobody knows what machines put down there.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "core/ground/base_columns.h"
#include "core/lattice/bytes.h"
#include "core/lattice/chunk_math.h"
#include "core/settle/column_samples.h"

namespace soilvdb::inline v0 {

/// Samples that scans and surveys added to each column, less what they removed.
class SurveyedSamples {
 public:
  struct Column {
    std::int32_t bank = 0, loose = 0;
  };

  void add(const Coord3& chunk, const ColumnCounts& counts) {
    Tile& tile = tiles_[{chunk.x(), chunk.y()}];
    for (std::size_t i = 0; i < tile.size(); ++i) {
      tile[i].bank += counts.bank[i];
      tile[i].loose += counts.loose[i];
    }
  }
  Column at(const Coord2& column) const {
    const Coord2 cell = floor_to(column, kChunkSide), in = column - cell;
    const auto found = tiles_.find({cell.x(), cell.y()});
    return found == tiles_.end()
               ? Column()
               : found->second[static_cast<std::size_t>(in.x() * kChunkSide + in.y())];
  }

  void save(std::string& out) const {
    put(out, std::uint64_t{tiles_.size()});
    for (const auto& [cell, tile] : tiles_) {
      put(out, cell.first, cell.second);
      for (const Column& column : tile) put(out, column.bank, column.loose);
    }
  }
  /// @throw std::invalid_argument if there are too few bytes, or they are not from save()
  static SurveyedSamples load(std::string_view& in) {
    SurveyedSamples all;
    std::uint64_t count = 0;
    take(in, count);
    for (std::uint64_t i = 0; i < count; ++i) {
      std::pair<int, int> cell;
      take(in, cell.first, cell.second);
      if (cell.first % kChunkSide != 0 || cell.second % kChunkSide != 0)
        throw std::invalid_argument("the state has a place of scans that can't be");
      for (Column& column : all.tiles_[cell]) take(in, column.bank, column.loose);
    }
    return all;
  }

 private:
  using Tile = std::array<Column, BaseColumn::kCells>;
  std::map<std::pair<int, int>, Tile> tiles_;  // by their lowest cells
};

}  // namespace soilvdb::inline v0
