// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "bench/digs.h"

#include "bench/report.h"

namespace soilvdb::bench {

Task task_of(const test::Dig& dig, double voxel_m) {
  Task task;
  task.voxel_m = voxel_m;
  task.origin = dig.origin;
  task.bucket = dig.bucket;
  task.motion = &dig.motion;
  task.terrain = dig.terrain;
  const double begin = dig.motion.begin_s(), length = dig.motion.end_s() - begin;
  constexpr int kPoses = 1000;
  for (int i = 0; i <= kPoses; ++i) {
    const Pose pose = dig.motion.pose(begin + length * i / kPoses);
    for (const Vec3& corner : mouth_outline(dig.bucket, pose)) task.reach.extend(corner);
  }
  return task;
}

Run run(const MakeEngine& make, const test::Dig& dig, double voxel_m, int updates, double cap_s) {
  Run result;
  const Stopwatch setup;
  const Task task = task_of(dig, voxel_m);
  const auto engine = make(task);
  result.setup_s = setup.seconds();
  const double begin = dig.motion.begin_s(), length = dig.motion.end_s() - begin;
  const Stopwatch all;
  double us = 0;
  for (int i = 0; i < updates; ++i) {
    const Step step{begin + length * i / updates, begin + length * (i + 1) / updates};
    engine->prepare(step);
    const Stopwatch watch;
    engine->advance(step);
    if (i + 1 == updates) engine->finish();
    us += watch.us();
    ++result.updates;
    result.us_per_update = us / result.updates;
    if (all.seconds() > cap_s && i + 1 < updates) return result;
  }
  result.complete = true;
  result.failures = engine->failures();
  result.error = engine->cut_m3() / dig.exact_m3 - 1;
  return result;
}

double check(const Peer& peer) {
  const test::Dig dig = test::make_dig("drag", test::placements()[1]);
  return run(peer.make, dig, 0.025, 20, 60).error;
}

}  // namespace soilvdb::bench
