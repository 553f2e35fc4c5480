// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground: base surface plus the voxels of the places where it changed.
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

/// One resident chunk of 8x8x8 voxels, at voxel x*64 + y*8 + z.
///
/// A voxel's cell is the cube of one voxel's side about its centre; it holds 64 sample points, and
/// a bit of `samples` for each says whether it is soil. That is all there is of the ground: volumes
/// are counted on samples, surfaces are made from them when somebody looks
/// (core/surface/surface.h).
struct Chunk {
  Coord3 origin;                  ///< index of the first voxel, a multiple of 8
  std::uint32_t swap_record = 0;  ///< of the swap store, which has the samples; 0: they are here
  std::uint16_t base_count = 0;   ///< samples of soil in the base surface
  std::uint16_t soil_count = 0;   ///< samples of soil now
  std::uint16_t loose_count = 0;  ///< those of them that are loose
  bool touched : 1 = false;       ///< listed for ChangeFollower
  bool above : 1 = false;         ///< soil was added that the base surface doesn't have
  std::uint8_t used : 2 = 0;  ///< how lately, where memory is limited: 2: since the last evict()
  Samples samples;            ///< of soil
  Samples loose;              ///< those of them that were moved: a subset

  std::size_t heap_bytes() const { return samples.heap_bytes() + loose.heap_bytes(); }
};

/// The ground of a site.
///
/// World = origin + h * index: voxel (i, j, k) has its centre there. The origin is double, so that
/// indices, grids and meshes stay near zero on sites in UTM coordinates.
///
/// A chunk that is not resident equals the base surface. Only GroundWriter changes the ground.
/// Where memory is limited, samples of chunks that haven't been used for long are in a swap store:
/// const members read them there.
///
/// Const members may run together with each other, and not while anyone changes the ground, but for
/// is_air(). set_memory_limit() and evict() run beside nothing. A clone() is a ground of its own to
/// all of this.
class Ground {
 public:
  /// @throw std::invalid_argument unless voxel_size_m is finite and > 0.
  Ground(double voxel_size_m, const Vec3& origin, std::shared_ptr<const InitialTerrain> terrain);
  ~Ground();
  /// The same ground, to be changed apart from this: neither sees what becomes of the other, and
  /// either may go first. They share the base surface, and the samples of each chunk until one of
  /// them changes it: it takes some tenths of a microsecond a chunk, and its memory what the leaves
  /// do. A ChangeFollower of this ground can be copied to follow the clone.
  /// @throw std::logic_error where some of it is in a swap store, which has one owner. The other's
  ///        memory isn't limited
  std::unique_ptr<Ground> clone() const;
  Ground(const Ground&) = delete;
  Ground& operator=(const Ground&) = delete;

  double voxel_size_m() const { return h_; }
  const Vec3& origin() const { return origin_; }
  /// Distance from the surface beyond which distances are clamped, voxels and metres.
  static constexpr int kBandVoxels = 3;
  double band_m() const { return kBandVoxels * h_; }
  /// Volume that one sample stands for, m^3.
  double sample_m3() const { return h_ * h_ * h_ / 64; }
  const InitialTerrain& terrain() const { return *terrain_; }
  /// The same, kept as long as the pointer is.
  const std::shared_ptr<const InitialTerrain>& shared_terrain() const { return terrain_; }

  /// The ground before anyone dug: the base surface, or what is beneath the grounds that it is of.
  const InitialTerrain& initial_terrain() const {
    return terrain_->ground() ? terrain_->ground()->initial_terrain() : *terrain_;
  }

  Vec3 world_from_index(const Vec3& index) const { return origin_ + h_ * index; }
  Vec3 index_from_world(const Vec3& p) const { return (p - origin_) / h_; }

  /// The chunk whose first voxel is `origin` (multiples of 8), or null if it isn't resident.
  const Chunk* find(const Coord3& origin) const;
  /// Resident chunks, ordered by origin (x, then y, then z).
  std::vector<const Chunk*> chunks() const;
  /// Where they are, in that order.
  std::vector<Coord3> origins() const;
  std::size_t chunk_count() const;
  /// The resident ground as OpenVDB has it: a voxel is active where its cell holds soil. The grid's
  /// transform is relative to origin(). Its users include soilvdb/sample_tree.h.
  const SampleGrid& grid() const;

  /// What a chunk that isn't resident would hold, its cells included.
  Content classify(const Coord3& origin) const;
  /// Is a box of the world surely free of soil, the base surface's and what was added above it?
  /// May run while others change the ground elsewhere.
  bool is_air(const Eigen::AlignedBox3d& box) const;

  /// Cells among which all soil lies that was added above the base surface's; empty: there is none.
  Eigen::AlignedBox3i above_base() const;

  /// Samples of a chunk, resident or not.
  void read_samples(const Coord3& origin, SampleWords& samples) const;
  /// Those of them that are loose.
  void read_loose(const Coord3& origin, SampleWords& loose) const;
  /// Those that the base surface has there.
  void read_base(const Coord3& origin, SampleWords& samples) const;
  /// A chunk as it is, swapped out or not.
  Chunk copy(const Chunk& chunk) const;

  /// Volume of the ground now less that of the base surface, counted anew, m^3.
  double change_m3() const;
  std::uint64_t active_voxels() const;  ///< cells of resident chunks that hold soil
  double resident_m2() const;           ///< footprint of the resident chunks
  /// What the ground holds of memory: the tree and its chunks, and what the base surface has read;
  /// what it shares with clones as well.
  std::uint64_t memory_bytes() const;
  /// From now on evict() keeps memory_bytes() to `bytes`, by sending chunks to `store`.
  void set_memory_limit(std::uint64_t bytes, std::shared_ptr<SwapStore> store);
  /// Sends the chunks that were not used for longest to the swap store where the ground holds more
  /// memory than it may, until it holds an eighth less. Until the next call it grows by what is
  /// used in between.
  /// @throw std::runtime_error if that can't be done; the ground is whole then
  void evict();
  /// Digest of voxel size, origin and every resident chunk's samples.
  std::uint64_t state_hash() const;

 private:
  friend class GroundWriter;
  friend class ChangeFollower;
  struct State;  // core/ground/ground_state.h
  void tell_followers();
  std::size_t load(Chunk& chunk) const;
  void store(Chunk& chunk);
  double h_;
  Vec3 origin_;
  std::shared_ptr<const InitialTerrain> terrain_;
  std::unique_ptr<State> state_;
  std::shared_ptr<SwapStore> store_;  // null: memory isn't limited
  std::uint64_t limit_bytes_ = 0;
};

}  // namespace soilvdb::inline v0
