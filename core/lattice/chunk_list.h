// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A list of chunks that changed.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "core/constants.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {

/// Origins of chunks. A chunk may be added any number of times: the list holds at most twice the
/// number of different chunks and kChunkListSlack more.
class ChunkList {
 public:
  void add(const Coord3& origin) {
    origins_.push_back(origin);
    if (origins_.size() < 2 * different_ + kChunkListSlack) return;
    sort_once(origins_);
    different_ = origins_.size();
  }
  /// Removes and returns all origins, sorted, without duplicates.
  std::vector<Coord3> take() {
    sort_once(origins_);
    different_ = 0;
    return std::exchange(origins_, {});
  }
  std::size_t bytes() const { return origins_.capacity() * sizeof(Coord3); }

 private:
  std::vector<Coord3> origins_;
  std::size_t different_ = 0;  // at the last count
};

}  // namespace soilvdb::inline v0
