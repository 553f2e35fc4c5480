// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The chunks that a box covers, and the order of chunks.
#pragma once

#include <algorithm>
#include <vector>

#include "soilvdb/initial_terrain.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// The order of chunks in all lists: by x, then y, then z.
inline bool before(const Coord3& a, const Coord3& b) {
  return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
}

struct Before {
  bool operator()(const Coord3& a, const Coord3& b) const { return before(a, b); }
};

/// Sorts origins and removes duplicates.
inline void sort_once(std::vector<Coord3>& origins) {
  std::sort(origins.begin(), origins.end(), before);
  origins.erase(std::unique(origins.begin(), origins.end()), origins.end());
}

/// Origin of the chunk whose cells contain a point, in index space.
inline Coord3 chunk_of(const Vec3& index) {
  return ((index + Vec3::Constant(0.5)) / kChunkSide).array().floor().matrix().cast<int>() *
         kChunkSide;
}

/// Calls `f(origin)` for each chunk from origin `first` to the chunk of voxel `last`, in order.
template <typename F>
void for_each_chunk(const Coord3& first, const Coord3& last, F f) {
  for (int x = first.x(); x <= last.x(); x += kChunkSide) {
    for (int y = first.y(); y <= last.y(); y += kChunkSide) {
      for (int z = first.z(); z <= last.z(); z += kChunkSide) f(Coord3(x, y, z));
    }
  }
}

/// Calls `f(origin)` for each chunk whose cells intersect a box in index space, in order.
template <typename F>
void for_each_chunk(const Eigen::AlignedBox3d& box, F f) {
  for_each_chunk(chunk_of(box.min()), chunk_of(box.max()), f);
}

}  // namespace soilvdb::inline v0
