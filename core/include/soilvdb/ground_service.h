// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What runs beside updates: meshes of what changed, and jobs that read the ground, on a copy of it.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "soilvdb/background.h"
#include "soilvdb/mesher.h"
#include "soilvdb/soil.h"

namespace soilvdb::inline v0 {

/// Keeps a copy of the ground up to date on a thread of its own, meshes what changed, and runs
/// jobs, snapshots for one, on the copy. Updates go on meanwhile: they only pay for copying the
/// chunks that changed.
///
/// Guarantees:
/// - A job sees the ground as it was at the last post() before it. None is dropped: if too many
///   wait, run() waits. Jobs go before meshes.
/// - The newest wins for meshes: a block that is asked for again before its turn is meshed once, as
///   it is then. After finish() all patches taken, each in place of the one before, are those of
///   SurfaceMesh on the ground, bit for bit.
/// - What waits is bounded: a copy of each changed chunk for each job and one more, a patch for
///   each block.
/// - With meshes it remembers 3 MB of what cells came to.
/// - All of it runs on one core, at a lower priority than the thread that made the service.
/// - An error of a job or of meshing is thrown once, by a later call (without a thread: by the call
///   itself). What that call was to do is done all the same; take_patches() leaves patches for the
///   next.
///
/// Functions may be called by one thread at a time.
///
/// ```
/// Soil copy(soil.voxel_size_m(), soil.origin(), base);
/// GroundService service(copy, {});
/// tracker.update(0, world_from_bucket);
/// service.post(soil, tracker.take_changed());
/// service.run([&] { save(copy); });
/// for (auto& patch : service.take_patches()) show(patch);
/// ```
class GroundService {
 public:
  struct Options {
    bool thread = true;         ///< else each call does its work before it returns
    bool meshes = true;         ///< patches are made
    std::size_t most_jobs = 4;  ///< that may wait, 1 or more
  };

  /// A block's part of the surface.
  struct Patch {
    Coord3 block;
    Mesh mesh;                     ///< empty: there is no surface any more
    std::uint64_t first_post = 0;  ///< the oldest of the posts that it brings news of, from 1 on
    std::uint64_t last_post = 0;   ///< it shows the ground as of this one
  };

  /// @param copy a soil without chunks, of the ground's voxel size, origin and base surface. The
  ///        service's own until it is destroyed: only jobs may read it.
  GroundService(Soil& copy, const Options& options);
  /// Runs all jobs; meshes nothing more. Errors not thrown yet are lost: finish() first.
  ~GroundService();

  /// Copies the chunks that changed.
  /// @param soil the ground, always the same
  /// @param changed Tracker::take_changed()
  void post(const Soil& soil, std::span<const Coord3> changed);

  /// Runs a job once the copy is as the ground was at the last post().
  void run(std::function<void()> job);

  /// Patches meshed since the last call, by block; of each block the newest.
  std::vector<Patch> take_patches();

  /// Waits until all is done and meshed that was asked for.
  void finish();

  /// Blocks meshed so far.
  std::uint64_t blocks_meshed() const;

 private:
  template <typename T>
  using ByOrigin = std::map<Coord3, T, SurfaceMesh::Less>;

  /// Chunks to put into the copy; none: to drop.
  struct Changes {
    ByOrigin<std::optional<Chunk>> chunks;
    std::uint64_t first_post = 0, last_post = 0;
  };

  void apply(Changes& changes);
  bool mesh_next();

  Soil& copy_;
  const Options options_;
  std::uint64_t posts_ = 0;

  // Of the service's thread.
  std::optional<CachedMesher> mesher_;
  std::deque<Coord3> to_mesh_;           // blocks in the order they were asked for
  ByOrigin<std::uint64_t> asked_;        // the same, with the first post that asked
  std::uint64_t applied_ = 0;            // the last post that the copy holds
  std::exception_ptr broken_ = nullptr;  // why the copy isn't the ground any more

  mutable std::mutex mutex_;  // for all below
  std::condition_variable job_began_;
  std::shared_ptr<Changes> newest_;  // that wait, with no job after them
  std::size_t jobs_ = 0;             // that wait
  ByOrigin<Patch> patches_;
  std::uint64_t blocks_meshed_ = 0;

  Background background_;  // last, so that it ends first
};

}  // namespace soilvdb::inline v0
