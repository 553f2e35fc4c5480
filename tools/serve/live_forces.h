// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The force of the soil on each bucket, for viewers that ask for it; tools/guide/live.md defines
// the message.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "soilvdb/ground_copy.h"
#include "soilvdb/height_map.h"
#include "soilvdb/session.h"

namespace soilvdb::tools {

inline constexpr const char* kForceNeedsSoil =
    "'force' needs the scenario's 'soil', which resists the bucket";

/// The message about a site with soil at another time. @param view its number
std::string force_message(Session& site, std::uint32_t view);

/// Computes the forces on the live buckets beside the feeds, on a copy of the ground.
class LiveForces {
 public:
  /// @param site with soil if compute() is called; read by compute() only
  /// @param copy of its ground, read by jobs only
  LiveForces(const Session& site, Ground& copy) : site_(site), copy_(copy) {}

  /// Has the message made as of now, unless one is being made.
  /// @param beside whose last post() was of the ground as it is now
  /// @param done receives the message on the thread of jobs
  void compute(GroundCopy& beside, std::function<void(std::string)> done);

 private:
  const Session& site_;
  std::atomic<bool> busy_ = false;
  std::uint64_t made_ = 0;
  // Used by jobs only.
  Ground& copy_;
  std::optional<HeightMap> heights_;
};

}  // namespace soilvdb::tools
