// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/ground_mcap.h"

#include "soilvdb/ground_service.h"

namespace soilvdb::tools {
namespace {

constexpr std::size_t kMostPatches = 32;  // in memory at once

}  // namespace

GroundMcap::GroundMcap(const std::filesystem::path& file, const SoilMcap::Site& site,
                       const Soil& soil, double time_s)
    : mcap_(file, site, time_s), mesher_(soil), elevation_(soil) {}

void GroundMcap::blocks(double time_s, std::span<const Coord3> changed) {
  std::vector<GroundService::Patch> patches;
  const auto put = [&] {
    mcap_.blocks(time_s, patches);
    patches.clear();
  };
  for (const Coord3& block : blocks_touched(changed)) {
    patches.push_back({block, mesher_.block(block)});
    if (patches.size() == kMostPatches) put();
  }
  put();
  not_in_map_.insert(not_in_map_.end(), changed.begin(), changed.end());
}

void GroundMcap::elevation(double time_s) {
  if (not_in_map_.empty()) return;
  elevation_.update(not_in_map_);
  not_in_map_.clear();
  mcap_.elevation(time_s, elevation_);
}

}  // namespace soilvdb::tools
