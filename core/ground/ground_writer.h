// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The only class that changes the ground.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Adds samples to a Ground and removes them.
///
/// Guarantees: counts, active voxels of the tree and the bounds of Ground::is_air() agree with the
/// samples. Loose samples are soil. Every ChangeFollower lists each chunk that appeared,
/// disappeared or changed. Chunks return from the swap store before they change. Removing samples
/// and adding them again, or the reverse, restores the same bits. The result of a call is the same
/// for any number of threads.
///
/// Several writers of one ground may edit() at once if they change different chunks. One thread
/// makes and fills each leaf outside the tree, and adds it under a lock, because OpenVDB's trees
/// must not be read while nodes are added. All other members need exclusive access.
class GroundWriter {
 public:
  explicit GroundWriter(Ground& ground) : ground_(ground) {}

  /// Whether samples are only removed, or may be added, too.
  enum class Operation { kRemove, kAdd };
  /// A chunk to change, with its work relative to other edits.
  struct Edit {
    Coord3 origin;
    std::size_t work = 1;
    const SampleWords* soil = nullptr;  ///< its samples, if they were read already
  };
  /// Changes the samples of edit `i`. It may change loose samples, too; samples that are no longer
  /// soil must not be loose. @return true if it changed a sample
  using Change = std::function<bool(std::size_t i, Samples& samples, Samples& loose)>;

  /// Calls `change` once for each chunk; a removal skips chunks without soil. Chunks become
  /// resident if they hold soil before or after.
  /// @param parallel_work least sum of work for which chunks are changed in parallel
  /// @throw exceptions of the initial terrain, of the swap store and of `change`; chunks that were
  ///        changed before stay changed
  void edit(Operation operation, std::span<const Edit> edits, std::size_t parallel_work,
            const Change& change);

  /// Removes or adds given samples of one chunk. @return number of changed samples
  std::int64_t remove(const Coord3& origin, const SampleWords& samples);
  /// @param kind of added soil
  enum class Kind { kBank, kLoose };
  std::int64_t add(const Coord3& origin, const SampleWords& samples, Kind kind = Kind::kBank);

  /// Sets a chunk: of a snapshot, or Ground::copy() of another ground with the same voxel size,
  /// origin and initial terrain.
  void put(Chunk chunk);
  /// The same with a ground's chunk, resident or not.
  void copy_from(const Ground& other, const Coord3& origin);
  /// Removes a resident chunk: the ground there is the initial terrain again.
  void drop(const Coord3& origin);

 private:
  struct Target;
  std::size_t find(Operation operation, std::span<const Edit> edits, std::span<Target> targets);
  void perform(Operation operation, const Edit& edit, Target& target, std::size_t i,
               const Change& change);
  void book(std::span<Target> targets);
  void load(Chunk& chunk);
  std::int64_t change(Operation operation, const Coord3& origin, const SampleWords& samples,
                      Kind kind);
  Ground& ground_;
};

/// Takes back what writers edit() while it lives. Until then it keeps what chunks were, beyond a
/// memory limit. All members need exclusive access to the ground.
class GroundUndo {
 public:
  /// @param ground has no other
  explicit GroundUndo(Ground& ground);
  ~GroundUndo();
  GroundUndo(const GroundUndo&) = delete;
  GroundUndo& operator=(const GroundUndo&) = delete;
  /// Sets all samples back. Followers hear of these changes while it lives; when it ends, their
  /// lists are as they were at its begin. @throw exceptions of the swap store; the ground is then
  /// unusable
  void undo();

 private:
  struct Before;
  Ground& ground_;
  std::unique_ptr<Before> before_;
};

}  // namespace soilvdb::inline v0
