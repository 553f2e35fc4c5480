// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/live_heights.h"

#include <utility>

#include "core/ground/ground_writer.h"

namespace soilvdb::tools {

LiveHeights::LiveHeights(Ground& live)
    : live_(live),
      changes_(live),
      copy_(live.voxel_size_m(), live.origin(), live.shared_terrain()),
      copied_(copy_),
      surface_(copy_) {}

void LiveHeights::post() {
  const std::vector<Coord3> changed = changes_.take();
  const std::lock_guard lock(mutex_);
  for (const Coord3& origin : changed) {
    const Chunk* const chunk = live_.find(origin);
    posted_.insert_or_assign(origin, chunk ? std::optional(live_.copy(*chunk)) : std::nullopt);
  }
}

void LiveHeights::at(std::span<const Vec2> xy_m, std::span<double> heights_m) {
  std::map<Coord3, std::optional<Chunk>, Before> posted;
  {
    const std::lock_guard lock(mutex_);
    posted.swap(posted_);
  }
  if (!posted.empty()) {
    GroundWriter writer(copy_);
    for (auto& [origin, now] : posted) {
      if (now)
        writer.put(std::move(*now));
      else
        writer.drop(origin);
    }
  }
  surface_.update(copied_.take());
  surface_.at(xy_m, heights_m);
}

}  // namespace soilvdb::tools
