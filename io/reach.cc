// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/reach.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>
#include <vector>

namespace soilvdb::io {
namespace {

using Box3 = Eigen::AlignedBox3d;

constexpr std::size_t kBlock = 64;       // rows looked at together at first
constexpr double kBytesPerChunk = 3500;  // a Chunk, its leaf, its share of index and tree
constexpr double kMostVoxels = 1 << 23;  // either way from the origin: 21 bits of chunks
constexpr int kPointsAcross = 8;         // of a mouth, where its sweep is estimated

/// Corners of everything of a bucket that digs, in the bucket frame.
std::vector<Vec3> corners(const Bucket& bucket) {
  std::vector<Vec3> all;
  for (const double y : {-bucket.width_m / 2, bucket.width_m / 2}) {
    for (const double z : {0.0, bucket.height_m}) all.emplace_back(0, y, z);
    for (const Vec2& p : bucket.profile) all.emplace_back(p.x(), y, p.y());
  }
  return all;
}

Box3 box_at(const std::vector<Vec3>& points, const Pose& world_from_bucket) {
  Box3 box;
  for (const Vec3& p : points) box.extend(world_from_bucket * p);
  return box;
}

/// A machine's way, by row and by block of rows.
struct Way {
  const MachineInput& machine;
  std::vector<Vec3> points;
  std::vector<Box3> intervals;  // the bucket between row i and row i + 1, or at the only row
  std::vector<Box3> blocks;     // of kBlock intervals
  Box3 whole;

  explicit Way(const MachineInput& m) : machine(m), points(corners(m.bucket)) {
    const std::vector<double>& times = m.motion.times_s();
    std::vector<Vec3> last(points.size()), next(points.size());
    for (std::size_t row = 0; row < times.size(); ++row) {
      const Pose pose = m.motion.pose(times[row]);
      double chord = 0;
      for (std::size_t i = 0; i < points.size(); ++i) {
        next[i] = pose * points[i];
        if (row > 0) chord = std::max(chord, (next[i] - last[i]).norm());
      }
      if (row > 0 || times.size() == 1) {
        Box3 box;
        for (const Vec3& p : next) box.extend(p);
        if (row > 0) {
          for (const Vec3& p : last) box.extend(p);
        }
        // An arc of half a turn stands half its chord off it.
        const Vec3 bulge = Vec3::Constant(chord / 2);
        intervals.emplace_back(box.min() - bulge, box.max() + bulge);
        if ((intervals.size() - 1) % kBlock == 0) blocks.emplace_back();
        blocks.back().extend(intervals.back());
        whole.extend(intervals.back());
      }
      std::swap(last, next);
    }
  }
};

std::string range(const char* axis, double low, double high) {
  return fmt::format("{} {:.1f} to {:.1f}", axis, low, high);
}

void check_overlap(const Scenario& scenario, const Site& site, const std::vector<Way>& ways) {
  Box3 whole;
  for (const Way& way : ways) {
    whole.extend(way.whole);
    for (const Box3& box : way.intervals) {
      if (site.bounds.intersects({box.min().head<2>(), box.max().head<2>()})) return;
    }
  }
  throw InputError(
      scenario.file,
      fmt::format("no bucket ever comes over the terrain: the motion runs over {}, {}; the terrain "
                  "covers {}, {}; both must be in the same coordinates",
                  range("x", whole.min().x(), whole.max().x()),
                  range("y", whole.min().y(), whole.max().y()),
                  range("x", site.bounds.min().x(), site.bounds.max().x()),
                  range("y", site.bounds.min().y(), site.bounds.max().y())));
}

void check_distance(const Scenario& scenario, const Site& site, const Way& way) {
  const double h = site.soil->voxel_size_m();
  const Vec3 far = (way.whole.min() - site.soil->origin())
                       .cwiseAbs()
                       .cwiseMax((way.whole.max() - site.soil->origin()).cwiseAbs());
  if (far.maxCoeff() < kMostVoxels * h) return;
  throw InputError(scenario.file,
                   fmt::format("machine '{}' goes {:.0f} m from the site's origin, more than the "
                               "{:g} m that voxels of {:g} m can number; a voxel_size of {:.2g} or "
                               "more would do",
                               way.machine.name, far.maxCoeff(), kMostVoxels * h, h,
                               1.05 * far.maxCoeff() / kMostVoxels));
}

/// Looks ever closer, as excavate() will look at last, wherever the ground isn't known.
void check_known(const Scenario& scenario, const Site& site, const Way& way) {
  const BaseSurface& base = site.soil->base();
  const MachineInput& m = way.machine;
  const double h = site.soil->voxel_size_m();
  const std::vector<double>& times = m.motion.times_s();
  for (std::size_t block = 0; block < way.blocks.size(); ++block) {
    if (base.known(way.blocks[block])) continue;
    const std::size_t end = std::min((block + 1) * kBlock, way.intervals.size());
    for (std::size_t i = block * kBlock; i < end; ++i) {
      if (base.known(way.intervals[i])) continue;
      const double t0 = times[i], t1 = times[std::min(i + 1, times.size() - 1)];
      const std::vector<Pose> path = m.motion.trace(t0, t1, m.bucket, h / 100, 8 * h);
      for (std::size_t k = path.size() == 1 ? 0 : 1; k < path.size(); ++k) {
        const Box3 box = box_at(way.points, path[k]).merged(box_at(way.points, path[k - (k > 0)]));
        if (base.known(box)) continue;
        throw InputError(
            scenario.file,
            fmt::format(
                "machine '{}' reaches ground without a height between {:g} s and {:g} s, "
                "at {}, {}, {}; a terrain that has heights there would do, or a motion that "
                "keeps off",
                m.name, t0, t1, range("x", box.min().x(), box.max().x()),
                range("y", box.min().y(), box.max().y()),
                range("z", box.min().z(), box.max().z())));
      }
    }
  }
}

double memory_bytes() {
  return static_cast<double>(::sysconf(_SC_PHYS_PAGES)) *
         static_cast<double>(::sysconf(_SC_PAGESIZE));
}

/// Cells of a coarse lattice through which a mouth sweeps and which hold soil, as a volume, m^3.
double swept_soil_m3(const Site& site, const Way& way, double cell_m, double enough_m3) {
  const MachineInput& m = way.machine;
  const BaseSurface& base = site.soil->base();
  const std::vector<double>& times = m.motion.times_s();
  const int ny = std::max(1, static_cast<int>(std::ceil(m.bucket.width_m / cell_m)));
  const int nz = std::max(1, static_cast<int>(std::ceil(m.bucket.height_m / cell_m)));
  std::set<std::tuple<std::int64_t, std::int64_t, std::int64_t>> seen;
  double volume = 0;
  const auto mark = [&](const Pose& pose) {
    for (int j = 0; j <= ny; ++j) {
      for (int k = 0; k <= nz; ++k) {
        const Vec3 p = pose * Vec3(0, (double(j) / ny - 0.5) * m.bucket.width_m,
                                   double(k) / nz * m.bucket.height_m);
        const Eigen::Array3d cell = (p.array() / cell_m).floor();
        if (!seen.emplace(cell.x(), cell.y(), cell.z()).second) continue;
        const Vec3 low = cell * cell_m;
        if (base.classify({low, low + Vec3::Constant(cell_m)}) != Content::kAir) {
          volume += cell_m * cell_m * cell_m;
        }
      }
    }
  };
  Pose last = m.motion.pose(times[0]);
  mark(last);
  for (std::size_t i = 0; i < way.intervals.size() && volume < enough_m3; ++i) {
    const Box3& box = way.intervals[i];
    if (base.classify(box) == Content::kAir) continue;
    const std::size_t next = std::min(i + 1, times.size() - 1);
    const Pose here = m.motion.pose(times[next]);
    double moved = 0;
    for (const Vec3& p : way.points) moved = std::max(moved, (here * p - last * p).norm());
    if (moved < cell_m / 2) continue;
    for (const Pose& pose : m.motion.trace(times[i], times[next], m.bucket, cell_m, cell_m)) {
      mark(pose);
    }
    last = here;
  }
  return volume;
}

void check_memory(const Scenario& scenario, const Site& site, const std::vector<Way>& ways) {
  const double h = site.soil->voxel_size_m(), chunk_m = kLeafSide * h;
  const double bytes_per_m3 = kBytesPerChunk / (chunk_m * chunk_m * chunk_m);
  const double limit = memory_bytes() / 2;
  // What holds in any case: the boxes about every stretch of the way.
  double most = 0;
  for (const Way& way : ways) {
    for (const Box3& box : way.intervals) {
      most += (box.sizes() + Vec3::Constant(chunk_m)).prod() * bytes_per_m3;
    }
  }
  if (most <= limit) return;
  double bytes = 0;
  for (const Way& way : ways) {
    const Bucket& bucket = way.machine.bucket;
    const double cell_m =
        std::max(chunk_m, std::max(bucket.width_m, bucket.height_m) / kPointsAcross);
    const double enough_m3 = 1000 * limit / bytes_per_m3;
    bytes += swept_soil_m3(site, way, cell_m, enough_m3) * bytes_per_m3;
  }
  if (bytes <= limit) return;
  const double enough = h * std::cbrt(bytes / limit);
  const double step = std::pow(10, std::floor(std::log10(enough)) - 1);
  throw InputError(
      scenario.file,
      fmt::format(
          "voxel_size {:g} is too small for what is dug: its voxels would take about {:.3g} "
          "GB, and this machine has {:.3g} GB; {:g} would do",
          h, bytes / 1e9, memory_bytes() / 1e9, std::ceil(enough / step) * step));
}

}  // namespace

void check_reach(const Scenario& scenario, const Site& site) {
  std::vector<Way> ways;
  ways.reserve(scenario.machines.size());
  for (const MachineInput& machine : scenario.machines) ways.emplace_back(machine);
  if (ways.empty()) return;
  check_overlap(scenario, site, ways);
  for (const Way& way : ways) check_distance(scenario, site, way);
  for (const Way& way : ways) check_known(scenario, site, way);
  check_memory(scenario, site, ways);
}

}  // namespace soilvdb::io
