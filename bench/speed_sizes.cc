// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>

#include "bench/engine.h"
#include "bench/site.h"
#include "bench/speed.h"
#include "soilvdb/tracker.h"

namespace soilvdb::bench {
namespace {

/// A stroke of 3 m through the hills, 0.4 m deep.
Motion stroke(const Vec2& from, double depth_m) {
  std::vector<double> times;
  std::vector<Pose> poses;
  constexpr int kRows = 60;
  for (int i = 0; i <= kRows; ++i) {
    const double s = static_cast<double>(i) / kRows;
    const Vec2 p = from + Vec2(3 * s, 0);
    Pose pose;
    pose.position << p, hill_height(from.x(), from.y()) - depth_m * std::sin(3.14159 * s);
    pose.rotation = from_rpy(0, 0.6 * s, 0.1);
    times.push_back(5 * s);
    poses.push_back(pose);
  }
  return {times, poses};
}

struct DepthCost {
  double us = 0;      ///< per update, the median of the strokes
  double cut_m3 = 0;  ///< in all
  int updates = 0;
};

/// Strokes side by side on a site, each as 100 updates. The first, which warms up, doesn't count.
DepthCost dig(Ground& ground, const Bucket& bucket, int strokes, double depth_m) {
  constexpr int kUpdates = 100;
  DepthCost cost;
  std::vector<double> us;
  Tracker tracker(ground, {bucket});
  for (int n = 0; n <= strokes; ++n) {
    const double cut_before = tracker.total().cut_m3();
    const Motion motion = stroke({-1.5, 1.3 * bucket.width_m * (n - strokes / 2)}, depth_m);
    Pose lifted = motion.pose(0);
    lifted.position.z() += 20;
    tracker.update(0, lifted);
    tracker.update(0, motion.pose(0));
    const Stopwatch watch;
    for (int i = 0; i < kUpdates; ++i) {
      tracker.update(0, motion, 5.0 * i / kUpdates, 5.0 * (i + 1) / kUpdates);
    }
    if (n > 0) {
      us.push_back(watch.us() / kUpdates);
      cost.cut_m3 += tracker.total().cut_m3() - cut_before;
      cost.updates += kUpdates;
    }
    tracker.update(0, lifted);
  }
  cost.us = quantile(us, 0.5);
  return cost;
}

double stock_us(double side_m, double voxel_m, int updates) {
  const Motion motion = stroke({-1.5, 0}, 0.4);
  Task task;
  task.voxel_m = voxel_m;
  task.bucket = excavator_bucket();
  task.motion = &motion;
  task.terrain = make_hills(side_m + 10);
  for (const double t : {0.0, 2.5, 5.0}) {
    for (const Vec3& corner : mouth_outline(task.bucket, motion.pose(t))) task.reach.extend(corner);
  }
  const double half = side_m / 2;
  task.site = Eigen::AlignedBox3d(Vec3(-half, -half, -8), Vec3(half, half, 8));
  const auto engine = make_openvdb_stock(task);
  Stopwatch watch;
  for (int i = 0; i < updates; ++i) engine->advance({i * 0.05, (i + 1) * 0.05});
  return watch.us() / updates;
}

}  // namespace

void measure_site_sizes(const Options& options, Goals& goals) {
  Csv csv(options.out / "site.csv", "engine,side_m,voxel_m,us_per_update,memory_bytes");
  constexpr double kVoxel_m = 0.05;
  std::vector<double> sides = {20, 100, 1000, 10000};
  if (options.quick) sides = {20};
  double least = 1e300, most = 0;
  for (const bool hills : {false, true}) {
    for (const double side : sides) {
      double best = 1e300, memory = 0;
      for (int repeat = 0; repeat < (options.quick ? 1 : 5); ++repeat) {
        Ground ground(kVoxel_m, Vec3::Zero(), hills ? make_hills(side) : make_plane(0, {0, 0}));
        best = std::min(best, dig(ground, excavator_bucket(), options.quick ? 1 : 10, 0.4).us);
        memory = static_cast<double>(ground.memory_bytes());
      }
      csv.row(fmt::format("soilvdb_{},{},{},{:.6g},{:.0f}", hills ? "hills" : "plane", side,
                          kVoxel_m, best, memory));
      if (hills) {
        least = std::min(least, best);
        most = std::max(most, best);
        goals.add({fmt::format("update on a hilly site of side {:g} m at 5 cm", side), best, "us"});
      }
    }
  }
  goals.add({"slowest over fastest, sites of 20 m to 10 km", most / least, "x", 1.1});
  for (const double side :
       options.quick ? std::vector{20.0} : std::vector{20.0, 50.0, 100.0, 200.0}) {
    const double us = stock_us(side, kVoxel_m, 2);
    csv.row(fmt::format("openvdb_stock,{},{},{:.6g},", side, kVoxel_m, us));
  }
}

void measure_voxel_sizes(const Options& options, Goals& goals) {
  Csv csv(options.out / "sizes.csv",
          "voxel_m,bucket_m,threads,us_per_update,updates_per_s,cut_voxels_per_s");
  const auto cost = [&](double voxel, double width, int threads, double height, double depth) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(threads));
    Ground ground(voxel, Vec3::Zero(), make_hills(1000));
    Bucket bucket = excavator_bucket();
    bucket.width_m = width;
    bucket.height_m = height;
    const DepthCost c = dig(ground, bucket, options.quick ? 1 : 6, depth);
    const double voxels = c.cut_m3 / std::pow(voxel, 3) / c.updates;
    csv.row(fmt::format("{},{},{},{:.6g},{:.6g},{:.6g}", voxel, width, threads, c.us, 1e6 / c.us,
                        voxels / c.us * 1e6));
    return c.us;
  };
  std::vector<double> voxels = {0.2, 0.1, 0.05, 0.025, 0.0125}, widths = {0.6, 1.2, 2.4, 4.8};
  if (options.quick) {
    voxels = {0.1, 0.05};
    widths = {1.2};
  }
  for (const double voxel : voxels) {
    for (const double width : widths) {
      for (const int threads : {1, 2}) {
        const double us = cost(voxel, width, threads, 0.8, 0.4);
        if (width == 1.2 && threads == 2) {
          goals.add(
              {fmt::format("update, bucket 1.2 m, {:g} cm, 2 threads", 100 * voxel), us, "us"});
        }
      }
    }
  }
  // A dozer's blade.
  const double voxel = options.quick ? 0.05 : 0.025;
  const double one = cost(voxel, 4, 1, 2, 1.5), two = cost(voxel, 4, 2, 2, 1.5);
  goals.add({fmt::format("blade 4 m x 2 m at {:g} cm: 2 threads over 1", 100 * voxel),
             one / two,
             "x",
             {},
             1.5,
             fmt::format("{:.0f} us and {:.0f} us", one, two)});
}

}  // namespace soilvdb::bench
