// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The one way to change the ground.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Adds samples to a Ground and removes them.
///
/// Guarantees: counts, the tree's active voxels and what Ground::is_air() knows agree with the
/// samples; what is loose is soil; every ChangeFollower
/// lists each chunk that came, went or changed; chunks come back from the swap store before they
/// change. Removing what is there and adding it again, or the other way round, leaves the samples
/// as they were, bit for bit. The result of a call is the same for any number of threads.
///
/// Several writers of one ground may edit() at once where they change different chunks: leaves are
/// made and filled apart from the tree, each by one thread, and added to it under a lock, because
/// OpenVDB's trees must not be read while nodes are added. All other members run beside nothing.
class GroundWriter {
 public:
  explicit GroundWriter(Ground& ground) : ground_(ground) {}

  /// Which way samples go.
  enum class Operation { kRemove, kAdd };
  /// A chunk to be changed, and how much work that is beside others.
  struct Edit {
    Coord3 origin;
    std::size_t work = 1;
  };
  /// Changes the samples of edit `i`, one way alone; what is loose of them it may change too, but
  /// what isn't soil any more isn't loose either. @return whether it did
  using Change = std::function<bool(std::size_t i, Samples& samples, Samples& loose)>;

  /// Calls `change` for each chunk, once; those that hold no soil are left out where soil is to be
  /// removed. Chunks become resident if they hold soil before or after.
  /// @param parallel_work from this much on chunks are changed in parallel
  /// @throw what reading the base surface or the swap store throws, and `change`; chunks that were
  ///        changed before that stay so
  void edit(Operation operation, std::span<const Edit> edits, std::size_t parallel_work,
            const Change& change);

  /// The same for given samples of one chunk. @return how many there were to remove, or to add
  std::int64_t remove(const Coord3& origin, const SampleWords& samples);
  /// `kind`: of what is added.
  enum class Kind { kBank, kLoose };
  std::int64_t add(const Coord3& origin, const SampleWords& samples, Kind kind = Kind::kBank);

  /// Makes a place what a chunk says: that of a snapshot, or Ground::copy() of another ground with
  /// the same voxel size, origin and base surface.
  void put(Chunk chunk);
  /// The same, of a ground's chunk or of what it has none of.
  void copy_from(const Ground& other, const Coord3& origin);
  /// Forgets a resident chunk: there the ground is the base surface again.
  void drop(const Coord3& origin);

 private:
  struct Target;
  std::size_t find(Operation operation, std::span<const Edit> edits, std::span<Target> targets);
  void perform(Operation operation, const Coord3& origin, Target& target, std::size_t i,
               const Change& change);
  void book(std::span<Target> targets);
  void load(Chunk& chunk);
  std::int64_t change(Operation operation, const Coord3& origin, const SampleWords& samples,
                      Kind kind);
  Ground& ground_;
};

}  // namespace soilvdb::inline v0
