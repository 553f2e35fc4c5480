// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A copy of the ground for jobs that run beside updates.
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

/// Runs jobs that read the ground, for example meshing and snapshots, on a worker thread and on a
/// copy. Updates continue meanwhile; they pay only for copying the changed chunks.
///
/// Guarantees:
/// - A job reads the ground as of the last post() before its run(). No job is dropped: a full queue
///   blocks run(), never post(). After an error of the copy all later jobs fail with that error.
class GroundCopy {
 public:
  /// @param copy a ground without chunks, with the voxel size, origin and initial terrain of the
  ///        source. GroundCopy owns its content until destruction: only jobs may read it.
  /// @param thread false: run() executes the job itself before it returns
  /// @param most_jobs maximum number of waiting jobs, >= 1
  explicit GroundCopy(Ground& copy, bool thread = true, std::size_t most_jobs = 4)
      : copy_(copy), background_(thread, most_jobs) {}

  /// Copies the changed chunks.
  /// @param ground the source ground, the same in each call
  /// @param changed origins from ChangeFollower::take()
  void post(const Ground& ground, std::span<const Coord3> changed);

  /// Queues a job on the copy as of the last post(). The destructor runs waiting jobs; their
  /// unthrown errors are lost: call finish() first.
  void run(std::function<void()> job);

  /// Whether all jobs have ended; the next run() then does not wait.
  bool done() const { return background_.done(); }
  /// Waits until all jobs have ended.
  void finish() { background_.wait(); }

 private:
  /// Chunks to put into the copy; std::nullopt: remove the chunk.
  using Changes = std::map<Coord3, std::optional<Chunk>, Before>;

  void apply(Changes& changes);

  Ground& copy_;
  Changes changes_;                      // since the last job
  std::exception_ptr broken_ = nullptr;  // why the copy is no longer valid; of the worker
  Background background_;                // last member: its jobs use the others
};

}  // namespace soilvdb::inline v0
