// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A copy of the ground beside updates, and jobs that read it.
#pragma once

#include <cstddef>
#include <exception>
#include <functional>
#include <map>
#include <optional>
#include <span>

#include "soilvdb/background.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Runs jobs that read the ground, meshing and snapshots for two, on a thread of its own and on a
/// copy. Updates go on meanwhile: they only pay for copying the chunks that changed.
///
/// Guarantees:
/// - A job sees the ground as it was at the last post() before it, also those that changed
///   meanwhile. None is dropped: if too many wait, run() waits; post() never does.
/// - What waits is bounded: a copy of each changed chunk for each job and one more.
/// - All of it runs on one core, at a lower priority than the thread that made it.
/// - An error of a job is thrown once, by a later call (without a thread: by the call itself). What
///   that call was to do is done all the same.
///
/// Functions may be called by one thread at a time.
///
/// ```
/// Ground copy(ground.voxel_size_m(), ground.origin(), ground.shared_terrain());
/// GroundCopy beside(copy);
/// ChangeFollower changes(ground);
/// tracker.update(0, world_from_bucket);
/// beside.post(ground, changes.take());
/// beside.run([&] { save(copy); });
/// ```
class GroundCopy {
 public:
  /// @param copy a ground without chunks, of the ground's voxel size, origin and base surface. Its
  ///        own until it is destroyed: only jobs may read it.
  /// @param thread else run() does its work before it returns
  /// @param most_jobs that may wait, 1 or more
  explicit GroundCopy(Ground& copy, bool thread = true, std::size_t most_jobs = 4)
      : copy_(copy), background_(thread, most_jobs) {}

  /// Copies the chunks that changed.
  /// @param ground the ground, always the same
  /// @param changed as a ChangeFollower lists them
  void post(const Ground& ground, std::span<const Coord3> changed);

  /// Runs a job once the copy is as the ground was at the last post(). All that were asked for run
  /// before this is destroyed; errors not thrown by then are lost: finish() first.
  void run(std::function<void()> job);

  /// Have all jobs ended? Who asks for the next one then never waits.
  bool done() const { return background_.done(); }
  /// Waits until they have.
  void finish() { background_.wait(); }

 private:
  /// Chunks to put into the copy; none: to drop.
  using Changes = std::map<Coord3, std::optional<Chunk>, Before>;

  void apply(Changes& changes);

  Ground& copy_;
  Changes changes_;                      // since the last job
  std::exception_ptr broken_ = nullptr;  // why the copy isn't the ground any more; of the thread
  Background background_;                // last, so that it ends first
};

}  // namespace soilvdb::inline v0
