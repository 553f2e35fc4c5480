// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/part.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "core/constants.h"
#include "core/ground/soil_writer.h"
#include "soilvdb/io/snapshot.h"

namespace soilvdb::tools {
namespace {

/// Forgets the chunks that none of the boxes, of the world, meets.
void keep_within(const std::vector<io::Box3>& boxes, Soil& soil) {
  std::vector<Coord3> beyond;
  for (const Chunk* chunk : soil.chunks()) {
    const Vec3 first = chunk->origin.cast<double>() - Vec3::Constant(0.5);
    const io::Box3 box(soil.world_from_index(first),
                       soil.world_from_index(first + Vec3::Constant(kChunkSide)));
    const auto meets = [&](const io::Box3& other) { return other.intersects(box); };
    if (std::none_of(boxes.begin(), boxes.end(), meets)) beyond.push_back(chunk->origin);
  }
  for (const Coord3& origin : beyond) SoilWriter(soil).drop(origin);
}

}  // namespace

io::Box3 reach_of(const Step& step, const Bucket& bucket, double voxel_size_m) {
  constexpr double kFar = 1e300;
  const std::vector<Vec3> points = extremes(bucket);
  io::Box3 box;
  for (const Pose& pose : step.motion->trace(step.begin_s, step.end_s, bucket, voxel_size_m, kFar))
    for (const Vec3& p : points) box.extend(pose * p);
  double radius_m = 0;
  for (const Vec3& p : points) radius_m = std::max(radius_m, p.norm());
  // Arcs between poses, and the rest of a chunk.
  const Vec3 wide = Vec3::Constant(radius_m + 2 * kChunkSide * voxel_size_m);
  return {box.min() - wide, box.max() + wide};
}

Start begin_of(const RunOptions& options, const io::Scenario& scenario) {
  if (!options.part) return {std::make_unique<SiteState>(scenario, io::open_site(scenario))};
  const Part& part = *options.part;
  io::SnapshotInfo info;
  io::Site site = io::read_snapshot(part.start, &info);
  Soil& soil = *site.soil;
  std::vector<io::Box3> reach(scenario.machines.size());
  Schedule schedule(scenario, options.updates, part.ends_s, kPathTolerance * soil.voxel_size_m(),
                    part);
  while (const std::optional<Step> step = schedule.next()) {
    reach[step->machine].extend(
        reach_of(*step, scenario.machines[step->machine].bucket, soil.voxel_size_m()));
  }
  std::erase_if(reach, [](const io::Box3& box) { return box.isEmpty(); });
  keep_within(reach, soil);
  auto state = std::make_unique<SiteState>(scenario, std::move(site));
  if (!info.tracker_state.empty()) state->set_progress(info.tracker_state);
  return {.state = std::move(state), .cut_before_m3 = info.cut_m3};
}

}  // namespace soilvdb::tools
