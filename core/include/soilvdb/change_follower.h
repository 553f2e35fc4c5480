// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Which chunks of the ground changed since somebody looked.
#pragma once

#include <memory>
#include <vector>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

class ChunkList;  // core/lattice/chunk_list.h

/// Lists the chunks that changed since its last look. A ground has any number of followers, each of
/// which sees every change. A follower that doesn't look holds the origin of each chunk that
/// changed, once.
///
/// All functions need exclusive access to the ground.
class ChangeFollower {
 public:
  /// @param ground outlives the last take()
  explicit ChangeFollower(Ground& ground);
  /// Follows a clone as `other` follows the ground that it was cloned from.
  ChangeFollower(Ground& clone, const ChangeFollower& other);
  ChangeFollower(ChangeFollower&&) = default;
  ChangeFollower& operator=(ChangeFollower&&) = default;

  /// Origins of the chunks that came, went or changed since the last call, sorted. The first call
  /// lists all resident chunks.
  std::vector<Coord3> take();

  /// Follows another ground of the same lattice: all chunks of both count as changed.
  void switch_to(Ground& other);

 private:
  friend class Ground;
  void follow(Ground& ground);
  void add_all(const Ground& ground);

  Ground* ground_ = nullptr;
  std::shared_ptr<ChunkList> changed_;  // the ground holds a weak reference
};

}  // namespace soilvdb::inline v0
