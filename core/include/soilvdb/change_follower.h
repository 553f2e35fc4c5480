// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Lists the chunks of the ground that changed since the last query.
#pragma once

#include <memory>
#include <vector>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

class ChunkList;  // core/lattice/chunk_list.h

/// Lists the chunks that changed since the last take(). A ground may have many followers; each
/// receives every change. Between calls a follower stores the origin of each changed chunk at most
/// twice.
///
/// take() may run while other threads change the ground elsewhere. All other functions need
/// exclusive access to the ground.
class ChangeFollower {
 public:
  /// @param ground must outlive the last take()
  explicit ChangeFollower(Ground& ground);
  /// Follows a clone from the state of `other`, which follows the cloned ground.
  ChangeFollower(Ground& clone, const ChangeFollower& other);
  ChangeFollower(ChangeFollower&&) = default;
  ChangeFollower& operator=(ChangeFollower&&) = default;

  /// Sorted origins of the chunks that were created, removed or changed since the last call. The
  /// first call returns all resident chunks.
  std::vector<Coord3> take();
  /// The same without getting memory. @param changed becomes them; the follower takes its memory in
  /// exchange
  void take(std::vector<Coord3>& changed);

  /// Follows another ground of the same lattice. All chunks of both grounds count as changed.
  void switch_to(Ground& other);

 private:
  friend class Ground;
  void follow(Ground& ground);
  void add_all(const Ground& ground);

  Ground* ground_ = nullptr;
  std::shared_ptr<ChunkList> changed_;  // the ground holds a weak reference
};

}  // namespace soilvdb::inline v0
