// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The state of a Ground: the tree, and notes on its chunks. For core/ground alone.
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <shared_mutex>
#include <vector>

#include "core/lattice/chunk_list.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/sample_tree.h"

namespace soilvdb::inline v0 {

inline openvdb::Coord to_coord(const Coord3& c) { return {c.x(), c.y(), c.z()}; }

struct Ground::State {
  /// Chunks that are made room for at a time.
  static constexpr std::size_t kLeastTouched = 16;
  // Last use of a chunk if memory is limited (Chunk::used).
  enum : std::uint8_t { kIdle, kUsed, kInUse };

  using Accessor = openvdb::tree::ValueAccessor<SampleTree, false>;
  using ConstAccessor = openvdb::tree::ValueAccessor<const SampleTree, false>;

  const SampleGrid::Ptr grid = SampleGrid::create();
  SampleTree& tree = grid->tree();
  std::size_t chunks = 0, lower_nodes = 0, upper_nodes = 0;
  ChunkList touched;                                // since the followers' lists were extended
  std::vector<std::weak_ptr<ChunkList>> followers;  // ChangeFollower's lists
  /// Bounds of the cells of chunks with soil above the initial terrain, index space; may be empty.
  Eigen::AlignedBox3i above;
  std::atomic<bool> any_above = false;
  /// For GroundUndo: what changed chunks were; nullopt: not resident. Null: not wanted.
  using Before = std::map<Coord3, std::optional<Chunk>, soilvdb::Before>;
  Before* before = nullptr;
  /// Shared to find leaves, exclusive to add leaves or change the members above. A leaf belongs to
  /// its writer, which holds no lock while it fills the leaf.
  mutable std::shared_mutex mutex;

  // With a memory limit.
  std::vector<Coord3> in_use;
  std::uint64_t idle_bytes = 0;  // samples of chunks that are not in use
  std::size_t hand = 0;          // of the clock algorithm: the last visited leaf

  State() = default;
  State(const State& other);

  SampleLeaf* find(const Coord3& origin) { return tree.probeLeaf(to_coord(origin)); }

  void add(SampleLeaf* leaf, Accessor& accessor) {
    const openvdb::Coord& at = leaf->origin();
    if (accessor.probeNode<SampleLower>(at) == nullptr) {
      if (accessor.probeNode<SampleUpper>(at) == nullptr) ++upper_nodes;
      ++lower_nodes;
    }
    accessor.addLeaf(leaf);
    ++chunks;
  }
  void touch(Chunk& chunk) {
    if (chunk.touched) return;
    if (touched.size() == 0 || touched.size() == touched.capacity()) make_room();
    touched.add(chunk.origin);
    chunk.touched = true;
  }
  /// Gets the memory that followers need to be told of more: they look when it must not be got.
  void make_room() {
    touched.reserve(kLeastTouched);
    for (const auto& follower : followers)
      if (const auto changed = follower.lock()) changed->reserve(touched.capacity());
  }
  void note_above(const Chunk& chunk) {
    if (!chunk.above) return;
    above.extend(
        Eigen::AlignedBox3i(chunk.origin, chunk.origin + Coord3::Constant(kChunkSide - 1)));
    any_above.store(true, std::memory_order_release);
  }
  /// Notes that a chunk is in use, because its samples may change. @param fresh it is a new chunk
  void use(Chunk& chunk, bool fresh = false) {
    if (chunk.used == kInUse) return;
    if (!fresh) idle_bytes -= chunk.heap_bytes();
    chunk.used = kInUse;
    in_use.push_back(chunk.origin);
  }

  std::vector<SampleLeaf*> leaves() {
    std::vector<SampleLeaf*> all;
    all.reserve(chunks);
    tree.getNodes(all);
    return all;
  }
  /// Bytes of the tree without the chunks' samples.
  std::size_t bytes() const {
    // A piece's length, and what rounds it up to sixteen bytes.
    const auto piece = [](std::size_t size) { return (size + kHeapWord + 15) / 16 * 16; };
    constexpr std::size_t kMapNode = 4 * sizeof(void*) + sizeof(openvdb::Coord) + 20;
    return chunks * piece(sizeof(SampleLeaf)) + lower_nodes * piece(sizeof(SampleLower)) +
           upper_nodes * (piece(sizeof(SampleUpper)) + piece(kMapNode)) +
           (touched.size() + in_use.capacity()) * sizeof(Coord3);
  }
};

}  // namespace soilvdb::inline v0
