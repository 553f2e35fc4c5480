// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A list of chunks that changed.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "core/constants.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {

/// Origins of chunks. A chunk may be added any number of times: the list holds at most twice the
/// number of different chunks and kChunkListSlack more. It keeps its memory.
class ChunkList {
 public:
  void add(const Coord3& origin) {
    origins_.push_back(origin);
    if (origins_.size() < 2 * different_ + kChunkListSlack) return;
    sort_once(origins_);
    different_ = origins_.size();
  }
  /// All origins, sorted, without duplicates; valid until the list changes.
  std::span<const Coord3> sorted() {
    sort_once(origins_);
    different_ = origins_.size();
    return origins_;
  }
  void clear() {
    origins_.clear();
    different_ = 0;
  }
  /// Removes all origins. @param taken becomes them as they were added, some several times; the
  /// list takes its memory in exchange
  void take(std::vector<Coord3>& taken) {
    taken.swap(origins_);
    clear();
  }
  /// Gets memory, so that add() of so many more needs none.
  void reserve(std::size_t more) {
    const std::size_t all = origins_.size() + more;
    if (all > origins_.capacity()) origins_.reserve(std::max(all, 2 * origins_.capacity()));
  }
  std::size_t size() const { return origins_.size(); }
  std::size_t capacity() const { return origins_.capacity(); }

 private:
  std::vector<Coord3> origins_;
  std::size_t different_ = 0;  // at the last count
};

}  // namespace soilvdb::inline v0
