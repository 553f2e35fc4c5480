// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights of the live ground for a thread of queries.
#pragma once

#include <map>
#include <mutex>
#include <optional>
#include <span>

#include "soilvdb/change_follower.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/ground.h"
#include "soilvdb/surface_height.h"

namespace soilvdb::tools {

/// Keeps a copy of the ground and the meshes of places that were asked for, so a query meshes only
/// what has changed there since the last one.
class LiveHeights {
 public:
  /// @param live the site's ground, which must outlive the last post()
  explicit LiveHeights(Ground& live);

  /// Takes over the ground as of now. On the thread of the live ground.
  void post();
  /// Heights of the ground as of the last post(), m; NaN without soil. On the thread of queries.
  void at(std::span<const Vec2> xy_m, std::span<double> heights_m);

 private:
  Ground& live_;
  ChangeFollower changes_;
  Ground copy_;
  ChangeFollower copied_;
  SurfaceHeight surface_;
  std::mutex mutex_;                                       // guards `posted_`
  std::map<Coord3, std::optional<Chunk>, Before> posted_;  // empty: the chunk is removed
};

}  // namespace soilvdb::tools
