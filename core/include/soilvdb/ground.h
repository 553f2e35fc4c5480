// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground: an initial terrain plus voxels where the ground changed.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "soilvdb/initial_terrain.h"
#include "soilvdb/sample_tree_fwd.h"
#include "soilvdb/samples.h"
#include "soilvdb/swap_store.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// One resident chunk of 8x8x8 voxels; voxel (x, y, z) has number x*64 + y*8 + z.
///
/// The cell of a voxel is the cube of one voxel side about its centre. It holds 64 sample points;
/// each has a bit in `samples` that is set for soil. The samples are the only state of the ground:
/// volumes are sample counts, and surfaces are computed on demand (core/surface/surface.h).
struct Chunk {
  Coord3 origin;                  ///< index of the first voxel, a multiple of 8
  std::uint32_t swap_record = 0;  ///< record in the swap store that holds the samples; 0: in memory
  std::uint16_t base_count = 0;   ///< soil samples of the initial terrain
  std::uint16_t soil_count = 0;   ///< current soil samples
  std::uint16_t loose_count = 0;  ///< loose samples among them
  bool above : 1 = false;         ///< holds added soil that the initial terrain does not have
  std::uint8_t used : 2 = 0;      ///< recency under a memory limit; 2: since the last evict()
  bool touched = false;           ///< listed for ChangeFollower; the ground's lock guards it
  Samples samples;                ///< soil samples
  Samples loose;                  ///< samples of moved soil, a subset of `samples`

  std::size_t heap_bytes() const { return samples.heap_bytes() + loose.heap_bytes(); }
};

/// The ground of a site.
///
/// The centre of voxel (i, j, k) is at origin + h * (i, j, k) in the world. The origin is double,
/// so that indices, grids and meshes stay near zero on sites in UTM coordinates.
///
/// A chunk that is not resident equals the initial terrain. Only GroundWriter changes the ground.
/// Under a memory limit the swap store holds the samples of chunks that were not used recently;
/// const members read them there.
///
/// Const members may run together. They must not run while the ground changes, except is_air() and
/// above_base(), and find(), read_*() and copy() of chunks that do not change. set_memory_limit()
/// and evict() must run alone. A clone() counts as a separate ground in these rules.
class Ground {
 public:
  /// @throw std::invalid_argument unless voxel_size_m is finite and > 0
  Ground(double voxel_size_m, const Vec3& origin, std::shared_ptr<const InitialTerrain> terrain);
  ~Ground();
  /// An independent copy of this ground: later changes to one do not affect the other, and either
  /// may be destroyed first. Both share the initial terrain, and each chunk's samples until one of
  /// them changes the chunk. The time is some tenths of a microsecond per chunk; the memory is that
  /// of the leaves. A ChangeFollower of this ground can be copied to follow the clone. The clone
  /// has no memory limit.
  /// @throw std::logic_error if a chunk is in the swap store, which has one owner
  std::unique_ptr<Ground> clone() const;
  Ground(const Ground&) = delete;
  Ground& operator=(const Ground&) = delete;

  double voxel_size_m() const { return h_; }
  const Vec3& origin() const { return origin_; }
  /// Distances are clamped at this distance from the surface, in voxels and metres.
  static constexpr int kBandVoxels = 3;
  double band_m() const { return kBandVoxels * h_; }
  /// Volume per sample, m^3.
  double sample_m3() const { return h_ * h_ * h_ / 64; }
  const InitialTerrain& terrain() const { return *terrain_; }
  /// The initial terrain with shared ownership.
  const std::shared_ptr<const InitialTerrain>& shared_terrain() const { return terrain_; }

  /// The initial ground: the initial terrain, or the initial ground of the ground whose surface
  /// that is.
  const InitialTerrain& initial_terrain() const {
    return terrain_->ground() ? terrain_->ground()->initial_terrain() : *terrain_;
  }

  Vec3 world_from_index(const Vec3& index) const { return origin_ + h_ * index; }
  Vec3 index_from_world(const Vec3& p) const { return (p - origin_) / h_; }

  /// The chunk whose first voxel is `origin` (multiples of 8); null if it is not resident.
  const Chunk* find(const Coord3& origin) const;
  /// Resident chunks, ordered by origin (x, then y, then z).
  std::vector<const Chunk*> chunks() const;
  /// Origins of the resident chunks, in the same order.
  std::vector<Coord3> origins() const;
  std::size_t chunk_count() const;
  /// The resident ground as an OpenVDB grid: a voxel is active where its cell holds soil. The
  /// transform is relative to origin(). Users of the grid include soilvdb/sample_tree.h.
  const SampleGrid& grid() const;

  /// Content of the initial terrain in the cells of a chunk.
  Content classify(const Coord3& origin) const;
  /// Whether a box of the world is surely free of base soil and of added soil. May run while other
  /// threads change the ground elsewhere.
  bool is_air(const Eigen::AlignedBox3d& box) const;

  /// Bounds of the cells with soil added above the initial terrain; empty without added soil.
  Eigen::AlignedBox3i above_base() const;

  /// Soil samples of a chunk, resident or not.
  void read_samples(const Coord3& origin, SampleWords& samples) const;
  /// Loose samples of a chunk, resident or not.
  void read_loose(const Coord3& origin, SampleWords& loose) const;
  /// Soil samples of the initial terrain in a chunk.
  void read_base(const Coord3& origin, SampleWords& samples) const;
  /// A copy of a chunk, with its samples in memory.
  Chunk copy(const Chunk& chunk) const;

  /// Current volume minus the initial terrain's volume, counted anew, m^3.
  double change_m3() const;
  std::uint64_t active_voxels() const;  ///< voxels of resident chunks whose cells hold soil
  double resident_m2() const;           ///< footprint of the resident chunks
  /// Memory of the tree, its chunks and the data cached by the initial terrain, including memory
  /// shared with clones.
  std::uint64_t memory_bytes() const;
  /// Makes evict() keep memory_bytes() within `bytes` by moving chunks to `store`.
  /// @throw std::logic_error if a limit is already set
  void set_memory_limit(std::uint64_t bytes, std::shared_ptr<SwapStore> store);
  /// If the memory exceeds the limit, moves the least recently used chunks to the swap store until
  /// it is an eighth below the limit. Memory grows by the chunks used until the next call.
  /// @throw std::runtime_error if the limit cannot be kept; the ground is then complete
  void evict();
  /// Digest of voxel size, origin and the soil and loose samples of all resident chunks.
  std::uint64_t state_hash() const;

 private:
  friend class GroundWriter;
  friend class ChangeFollower;
  friend class GroundUndo;
  struct State;  // core/ground/ground_state.h
  void tell_followers();
  std::size_t load(Chunk& chunk) const;
  void store(Chunk& chunk);
  double h_;
  Vec3 origin_;
  std::shared_ptr<const InitialTerrain> terrain_;
  std::unique_ptr<State> state_;
  std::shared_ptr<SwapStore> store_;  // null: no memory limit
  std::uint64_t limit_bytes_ = 0;
};

}  // namespace soilvdb::inline v0
