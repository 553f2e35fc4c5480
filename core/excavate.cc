// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/excavate.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <string>

#include "core/affine.h"
#include "core/chunk_range.h"
#include "core/polygon.h"

namespace soilvdb {
namespace {

/// Chunks times strokes below which one thread is quicker than two.
constexpr std::size_t kParallelWork = 64;

/// A facet moving over one segment of the path, seen from one chunk.
struct Stroke {
  AffineFrame a, b;                    // the facet's frame at both ends
  float y_low, y_high, z_low, z_high;  // bounds of its outline, voxels
};

struct Job {
  Chunk* chunk;
  const Facet* facet;
  Stroke stroke;
};

/// What strokes took out of a chunk.
struct Removed {
  std::int64_t captured = 0, displaced = 0;
};

/// How a facet books what it removes. Behind the mouth of a bucket with a body lies the body: soil
/// that the mouth leaves backwards was displaced by the body's back before, if in the same segment.
enum class Books { kCaptured, kCapturedAhead, kDisplaced };

/// One coordinate of a facet at both ends of a stroke, over boxes of one shape.
struct Span {
  Affine a, b;
  float ra, rb;  // most the values differ over a box from those at its centre

  Span() = default;
  Span(const Stroke& s, int axis, float half_x, float half_y, float half_z)
      : a(s.a.axis[axis]),
        b(s.b.axis[axis]),
        ra(a.reach(half_x, half_y, half_z)),
        rb(b.reach(half_x, half_y, half_z)) {}

  bool may_cross_zero(float x, float y, float z) const {
    const float u = a.at(x, y, z), v = b.at(x, y, z);
    return !((u > ra && v > rb) || (u < -ra && v < -rb));
  }
  bool surely_crosses_zero(float x, float y, float z) const {
    const float u = a.at(x, y, z), v = b.at(x, y, z);
    return (u > ra && v < -rb) || (u < -ra && v > rb);
  }
  bool meets(float x, float y, float z, float low, float high) const {
    const float u = a.at(x, y, z), v = b.at(x, y, z);
    return std::max(u + ra, v + rb) >= low && std::min(u - ra, v - rb) <= high;
  }
  bool within(float x, float y, float z, float low, float high) const {
    const float u = a.at(x, y, z), v = b.at(x, y, z);
    return std::min(u - ra, v - rb) > low && std::max(u + ra, v + rb) < high;
  }
};

/// The three of them.
struct Spans {
  Span x, y, z;
  Spans(const Stroke& s, float half_x, float half_y, float half_z)
      : x(s, 0, half_x, half_y, half_z),
        y(s, 1, half_x, half_y, half_z),
        z(s, 2, half_x, half_y, half_z) {}
  bool may_cut(const Stroke& s, float px, float py, float pz) const {
    return x.may_cross_zero(px, py, pz) && y.meets(px, py, pz, s.y_low, s.y_high) &&
           z.meets(px, py, pz, s.z_low, s.z_high);
  }
};

/// Bit i is set where sample i is ahead of the facet's plane.
inline std::uint64_t ahead_of_plane(const CellPoints& p, Affine a) {
  std::uint64_t bits = 0;
  for (int i = 0; i < 64; ++i) bits |= std::uint64_t{a.at(p.x[i], p.y[i], p.z[i]) > 0} << i;
  return bits;
}

/// Bit i is set where sample i crosses the facet's plane.
inline std::uint64_t crossing_plane(const CellPoints& p, Affine a, Affine b) {
  std::uint32_t half[2];
  for (int g = 0; g < 2; ++g) {
    std::uint32_t bits = 0;
    for (int i = 0; i < 32; ++i) {
      const int n = g * 32 + i;
      const float u = a.at(p.x[n], p.y[n], p.z[n]), v = b.at(p.x[n], p.y[n], p.z[n]);
      bits |= ((u > 0) != (v > 0)) ? kBits.bit[i] : 0u;
    }
    half[g] = bits;
  }
  return std::uint64_t{half[1]} << 32 | half[0];
}

/// Bit i is set where sample i crosses the facet's rectangle. At the crossing, the fraction
/// u / (u - v) of the segment, y is (y_a v - y_b u) / (v - u); the division is multiplied out.
inline std::uint64_t crossing_rectangle(const CellPoints& p, const Stroke& s) {
  const Stroke t = s;  // so that the compiler knows nothing else writes to it
  std::uint32_t half[2];
  for (int g = 0; g < 2; ++g) {
    std::uint32_t bits = 0;
    for (int i = 0; i < 32; ++i) {
      const int n = g * 32 + i;
      const float px = p.x[n], py = p.y[n], pz = p.z[n];
      const float u = t.a.axis[0].at(px, py, pz), v = t.b.axis[0].at(px, py, pz);
      const float sign = v > u ? 1.0f : -1.0f;
      const float whole = (v - u) * sign;
      const float y = (t.a.axis[1].at(px, py, pz) * v - t.b.axis[1].at(px, py, pz) * u) * sign;
      const float z = (t.a.axis[2].at(px, py, pz) * v - t.b.axis[2].at(px, py, pz) * u) * sign;
      const bool in = ((u > 0) != (v > 0)) & (y >= t.y_low * whole) & (y <= t.y_high * whole) &
                      (z >= t.z_low * whole) & (z <= t.z_high * whole);
      bits |= in ? kBits.bit[i] : 0u;
    }
    half[g] = bits;
  }
  return std::uint64_t{half[1]} << 32 | half[0];
}

/// Of the samples in `candidates`, which all cross the plane, those inside the facet's outline.
std::uint64_t crossing_outline(const CellPoints& p, const Stroke& s, const Facet& facet, double h,
                               std::uint64_t candidates) {
  std::uint64_t hit = 0;
  for (; candidates != 0; candidates &= candidates - 1) {
    const int n = std::countr_zero(candidates);
    double a[3], b[3];
    for (int axis = 0; axis < 3; ++axis) {
      a[axis] = s.a.axis[axis].at(p.x[n], p.y[n], p.z[n]);
      b[axis] = s.b.axis[axis].at(p.x[n], p.y[n], p.z[n]);
    }
    const double f = a[0] / (a[0] - b[0]);
    if (inside(facet.outline, h * Vec2(a[1] + f * (b[1] - a[1]), a[2] + f * (b[2] - a[2])))) {
      hit |= candidates & -candidates;
    }
  }
  return hit;
}

/// The stroke seen from another corner of the chunk.
Stroke moved(const Stroke& s, float x, float y, float z) {
  Stroke m = s;
  for (int axis = 0; axis < 3; ++axis) {
    m.a.axis[axis].c = s.a.axis[axis].at(x, y, z);
    m.b.axis[axis].c = s.b.axis[axis].at(x, y, z);
  }
  return m;
}

/// Takes what the stroke passes through out of its chunk.
SOILVDB_FOR_CPUS Removed cut_chunk(const Job& job, double h, Books books) {
  Samples& samples = job.chunk->samples;
  const Stroke& s = job.stroke;
  const Spans row(s, 0.5f, 0.5f, 0.5f * kLeafSide), cell(s, 0.5f, 0.5f, 0.5f);
  Removed removed;
  for (int n = 0; n < kLeafSize; n += kLeafSide) {
    std::uint32_t soil = samples.any_of_row(n);
    const float x0 = static_cast<float>(n >> 6), y0 = static_cast<float>(n >> 3 & 7);
    const float cx = x0 + 0.5f, cy = y0 + 0.5f;
    if (soil == 0 || !row.may_cut(s, cx, cy, 0.5f * kLeafSide)) continue;
    for (; soil != 0; soil &= soil - 1) {
      const int z = std::countr_zero(soil);
      const float z0 = static_cast<float>(z), cz = z0 + 0.5f;
      if (!cell.may_cut(s, cx, cy, cz)) continue;
      const std::uint64_t word = samples.word(n + z);
      const bool middle = job.facet->rectangle && cell.y.within(cx, cy, cz, s.y_low, s.y_high) &&
                          cell.z.within(cx, cy, cz, s.z_low, s.z_high);
      std::uint64_t hit = word;
      if (!middle || !cell.x.surely_crosses_zero(cx, cy, cz)) {
        const CellPoints& points = sample_points(job.chunk->origin + Coord3(n >> 6, n >> 3 & 7, z));
        const Stroke local = moved(s, x0, y0, z0);
        if (!middle && job.facet->rectangle) {
          hit &= crossing_rectangle(points, local);
        } else {
          hit &= crossing_plane(points, local.a.axis[0], local.b.axis[0]);
          if (!middle && hit != 0) hit = crossing_outline(points, local, *job.facet, h, hit);
        }
      }
      if (hit == 0) continue;
      samples.set_word(n + z, word ^ hit);
      std::uint64_t captured = books == Books::kDisplaced ? 0 : hit;
      if (books == Books::kCapturedAhead) {
        const CellPoints& points = sample_points(job.chunk->origin + Coord3(n >> 6, n >> 3 & 7, z));
        captured &= ahead_of_plane(points, moved(s, x0, y0, z0).a.axis[0]);
      }
      removed.captured += std::popcount(captured);
      removed.displaced += std::popcount(hit ^ captured);
    }
  }
  job.chunk->now -= static_cast<std::uint32_t>(removed.captured + removed.displaced);
  return removed;
}

/// The chunk, made if it holds soil and isn't resident; null if there is no soil in it.
Chunk* with_soil(Soil& soil, const Coord3& origin) {
  Chunk* chunk = soil.find(origin);
  if (chunk == nullptr && soil.classify(origin) != Content::kAir) chunk = &soil.make(origin);
  return chunk != nullptr && chunk->now > 0 ? chunk : nullptr;
}

/// Where a facet is at one end of a segment, in index space.
struct Station {
  Eigen::Matrix3d axes;  // columns are the facet's
  Vec3 position;
  Eigen::AlignedBox3d box;

  Station(const Soil& soil, const Facet& facet, const Pose& world_from_bucket) {
    const Pose world_from_facet = world_from_bucket * facet.bucket_from_facet;
    axes = world_from_facet.rotation.toRotationMatrix();
    position = soil.index_from_world(world_from_facet.position);
    for (const double y : {facet.low.x(), facet.high.x()}) {
      for (const double z : {facet.low.y(), facet.high.y()}) {
        box.extend(position + (y * axes.col(1) + z * axes.col(2)) / soil.voxel_size_m());
      }
    }
  }
};

/// @throw NoGroundError where a box in index space holds ground without a height.
void require_known(const Soil& soil, const Eigen::AlignedBox3d& box) {
  const Vec3 low = soil.world_from_index(box.min()), high = soil.world_from_index(box.max());
  if (soil.base().known({low, high})) return;
  throw NoGroundError("the bucket reaches ground without a height at x " + std::to_string(low.x()) +
                      " to " + std::to_string(high.x()) + ", y " + std::to_string(low.y()) +
                      " to " + std::to_string(high.y()) + ", z " + std::to_string(low.z()));
}

/// The same for a segment, of which `box` is all. Only boxes of single poses are refused: that of a
/// segment reaches far beyond what the bucket passes.
void require_known(const Soil& soil, std::span<const Facet> facets, const Pose& from,
                   const Pose& to, const Eigen::AlignedBox3d& box) {
  if (soil.base().known({soil.world_from_index(box.min()), soil.world_from_index(box.max())}))
    return;
  constexpr int kPoses = 8;
  for (int k = 0; k <= kPoses; ++k) {
    const Pose pose = interpolate(from, to, static_cast<double>(k) / kPoses);
    for (const Facet& facet : facets) require_known(soil, Station(soil, facet, pose).box);
  }
}

/// Every facet and segment that may take something from a chunk, by chunk and then in the order of
/// the path. Makes the chunks.
std::vector<Job> find_jobs(Soil& soil, std::span<const Facet> facets, std::span<const Pose> path) {
  std::vector<Job> jobs;
  std::vector<Station> last, next;
  for (const Facet& facet : facets) last.emplace_back(soil, facet, path[0]);
  const float half = kLeafSide / 2.0f;
  for (std::size_t i = 1; i < path.size(); ++i) {
    next.clear();
    Eigen::AlignedBox3d whole;
    for (std::size_t f = 0; f < facets.size(); ++f) {
      next.emplace_back(soil, facets[f], path[i]);
      whole.extend(last[f].box.merged(next[f].box));
    }
    require_known(soil, facets, path[i - 1], path[i], whole);
    const Vec3 low = soil.world_from_index(whole.min()), high = soil.world_from_index(whole.max());
    if (soil.base().classify({low, high}) != Content::kAir) {
      for (std::size_t f = 0; f < facets.size(); ++f) {
        for_each_chunk(last[f].box.merged(next[f].box), [&](const Coord3& origin) {
          Stroke s;
          s.a = AffineFrame(last[f].axes, last[f].position, origin);
          s.b = AffineFrame(next[f].axes, next[f].position, origin);
          const float scale = static_cast<float>(1 / soil.voxel_size_m());
          s.y_low = static_cast<float>(facets[f].low.x()) * scale;
          s.y_high = static_cast<float>(facets[f].high.x()) * scale;
          s.z_low = static_cast<float>(facets[f].low.y()) * scale;
          s.z_high = static_cast<float>(facets[f].high.y()) * scale;
          if (!Spans(s, half, half, half).may_cut(s, half, half, half)) return;
          if (Chunk* chunk = with_soil(soil, origin)) jobs.push_back({chunk, &facets[f], s});
        });
      }
    }
    std::swap(last, next);
  }
  std::stable_sort(jobs.begin(), jobs.end(), [](const Job& a, const Job& b) {
    return before(a.chunk->origin, b.chunk->origin);
  });
  return jobs;
}

Facet rectangle(const Pose& bucket_from_facet, double y_low, double y_high, double z_high) {
  return {bucket_from_facet, {}, {y_low, 0}, {y_high, z_high}, true};
}

}  // namespace

std::vector<Facet> facets(const Bucket& bucket) {
  const double half = bucket.width_m / 2;
  std::vector<Facet> all{rectangle(Pose{}, -half, half, bucket.height_m)};
  for (std::size_t i = 1; i < bucket.profile.size(); ++i) {
    const Vec2 a = bucket.profile[i - 1], along = bucket.profile[i] - a;
    Eigen::Matrix3d axes;
    axes.col(1) = Vec3::UnitY();
    axes.col(2) = Vec3(along.x(), 0, along.y()).normalized();
    axes.col(0) = axes.col(1).cross(axes.col(2));
    all.push_back(
        rectangle({{a.x(), 0, a.y()}, Eigen::Quaterniond(axes)}, -half, half, along.norm()));
  }
  if (bucket.profile.empty()) return all;
  // The two sides: the facet's x is the bucket's y, its y the bucket's z, its z the bucket's x.
  Eigen::Matrix3d axes;
  axes << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  for (const double y : {-half, half}) {
    Facet side{{{0, y, 0}, Eigen::Quaterniond(axes)}, {}, {}, {}, false};
    Eigen::AlignedBox2d bounds;
    for (const Vec2& p : bucket.profile) {
      side.outline.emplace_back(p.y(), p.x());
      bounds.extend(side.outline.back());
    }
    side.low = bounds.min();
    side.high = bounds.max();
    all.push_back(side);
  }
  return all;
}

Cut excavate(Soil& soil, std::span<const Facet> facets, std::span<const Pose> path) {
  Cut cut;
  if (path.size() < 2 || facets.empty()) return cut;
  const std::vector<Job> jobs = find_jobs(soil, facets, path);
  std::vector<std::size_t> starts;  // of each chunk's jobs
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    if (i == 0 || jobs[i].chunk != jobs[i - 1].chunk) starts.push_back(i);
  }
  const std::size_t chunks = starts.size();
  starts.push_back(jobs.size());
  std::vector<Removed> removed(chunks);
  const Facet* mouth = &facets.front();
  const Books through_mouth = facets.size() > 1 ? Books::kCapturedAhead : Books::kCaptured;
  const auto cut_one = [&](std::size_t c) {
    for (std::size_t i = starts[c]; i < starts[c + 1]; ++i) {
      const Books books = jobs[i].facet == mouth ? through_mouth : Books::kDisplaced;
      const Removed part = cut_chunk(jobs[i], soil.voxel_size_m(), books);
      removed[c].captured += part.captured;
      removed[c].displaced += part.displaced;
    }
  };
  if (jobs.size() >= kParallelWork) {
    tbb::parallel_for(std::size_t{0}, chunks, cut_one);
  } else {
    for (std::size_t c = 0; c < chunks; ++c) cut_one(c);
  }
  for (std::size_t c = 0; c < chunks; ++c) {
    cut.captured += removed[c].captured;
    cut.displaced += removed[c].displaced;
    if (removed[c].captured + removed[c].displaced > 0)
      cut.changed.push_back(jobs[starts[c]].chunk->origin);
  }
  return cut;
}

Cut stamp(Soil& soil, const Bucket& bucket, const Pose& world_from_bucket) {
  Cut cut;
  if (bucket.profile.empty()) return cut;
  Eigen::AlignedBox3d box;
  for (const Facet& facet : facets(bucket)) box.extend(Station(soil, facet, world_from_bucket).box);
  require_known(soil, box);
  const Pose bucket_from_world = world_from_bucket.inverse();
  for_each_chunk(box, [&](const Coord3& origin) {
    Chunk* chunk = with_soil(soil, origin);
    if (chunk == nullptr) return;
    std::int64_t removed = 0;
    for (int n = 0; n < kLeafSize; ++n) {
      const std::uint64_t word = chunk->samples.word(n);
      if (word == 0) continue;
      const Coord3 voxel = origin + Coord3(n >> 6, n >> 3 & 7, n & 7);
      const CellPoints& points = sample_points(voxel);
      const Vec3 low = voxel.cast<double>() - Vec3::Constant(0.5);
      std::uint64_t hit = 0;
      for (int i = 0; i < 64; ++i) {
        const Vec3 p = bucket_from_world *
                       soil.world_from_index(low + Vec3(points.x[i], points.y[i], points.z[i]));
        const bool in =
            std::abs(p.y()) <= bucket.width_m / 2 && inside(bucket.profile, {p.x(), p.z()});
        hit |= std::uint64_t{in} << i;
      }
      hit &= word;
      removed += std::popcount(hit);
      chunk->samples.set_word(n, word ^ hit);
    }
    if (removed == 0) return;
    chunk->now -= static_cast<std::uint32_t>(removed);
    cut.displaced += removed;
    cut.changed.push_back(origin);
  });
  return cut;
}

}  // namespace soilvdb
