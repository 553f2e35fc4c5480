// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cut/excavator.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <string>

#include "core/constants.h"
#include "core/cut/tool_cut.h"
#include "core/lattice/chunk_math.h"
#include "core/tool/polygon.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {
namespace {

double chunks_in(const Eigen::AlignedBox3d& box) {
  return ((box.sizes() / kChunkSide).array() + 1).prod();
}

Eigen::AlignedBox3d in_world(const Ground& ground, const Eigen::AlignedBox3d& box) {
  return {ground.world_from_index(box.min()), ground.world_from_index(box.max())};
}

/// Do a facet's coordinates of a chunk's middle at both ends of a stroke allow that it cuts there?
/// @param low, high bounds of its outline, voxels
bool may_cut(const float* a, const float* ra, const float* b, const float* rb, const Vec2& low,
             const Vec2& high) {
  if ((a[0] > ra[0] && b[0] > rb[0]) || (a[0] < -ra[0] && b[0] < -rb[0])) return false;
  const auto meets = [&](int axis, double least, double most) {
    return std::max(a[axis] + ra[axis], b[axis] + rb[axis]) >= least - kMaxBend &&
           std::min(a[axis] - ra[axis], b[axis] - rb[axis]) <= most + kMaxBend;
  };
  return meets(1, low.x(), high.x()) && meets(2, low.y(), high.y());
}

}  // namespace

Excavator::FacetPlace Excavator::place(const Ground& ground, const Facet& facet,
                                       const Pose& world_from_bucket) const {
  FacetPlace s;
  const Pose world_from_facet = world_from_bucket * facet.bucket_from_facet;
  s.axes = world_from_facet.rotation.toRotationMatrix();
  s.position = ground.index_from_world(world_from_facet.position);
  for (const double y : {facet.low.x(), facet.high.x()}) {
    for (const double z : {facet.low.y(), facet.high.y()}) {
      s.box.extend(s.position + (y * s.axes.col(1) + z * s.axes.col(2)) / ground.voxel_size_m());
    }
  }
  for (int a = 0; a < 3; ++a) {
    s.half_range[a] =
        static_cast<float>(s.axes.col(a).cwiseAbs().sum() * kChunkSide / 2) + kChunkRounding;
  }
  return s;
}

/// Box of the bucket's facets at a pose of the path.
Eigen::AlignedBox3d Excavator::box(std::size_t pose) const {
  Eigen::AlignedBox3d all;
  for (std::size_t f = 0; f < facets_.size(); ++f)
    all.extend(places_[pose * facets_.size() + f].box);
  return all;
}

/// Only boxes of single poses are refused: the box of a segment is much larger than the swept
/// volume.
void Excavator::require_known(const Ground& ground, std::span<const Pose> path) const {
  const auto check = [&](const Pose& pose) {
    for (const Facet& facet : facets_) {
      const Eigen::AlignedBox3d world = in_world(ground, place(ground, facet, pose).box);
      if (ground.terrain().has_data(world)) continue;
      const Vec3 &low = world.min(), &high = world.max();
      throw NoGroundError("the bucket reaches ground without a height at x " +
                          std::to_string(low.x()) + " to " + std::to_string(high.x()) + ", y " +
                          std::to_string(low.y()) + " to " + std::to_string(high.y()) + ", z " +
                          std::to_string(low.z()));
    }
  };
  if (path.size() == 1) return check(path.front());
  for (std::size_t i = 1; i < path.size(); ++i) {
    if (ground.terrain().has_data(in_world(ground, box(i - 1).merged(box(i))))) continue;
    for (int k = 0; k <= kGroundCheckParts; ++k)
      check(interpolate(path[i - 1], path[i], static_cast<double>(k) / kGroundCheckParts));
  }
}

AffineFrame Excavator::frame(std::size_t pose, std::size_t facet, const Coord3& origin) const {
  const FacetPlace& s = places_[pose * facets_.size() + facet];
  return {s.axes, s.position, origin};
}

/// Appends the strokes that may cut in a chunk between two poses of the path, in order.
void Excavator::find_strokes(const Coord3& origin, std::size_t first, std::size_t last,
                             double voxel_size_m) {
  const Vec3 middle = origin.cast<double>() + Vec3::Constant((kChunkSide - 1) / 2.0);
  const auto coordinates = [&](const FacetPlace& s, float* c) {
    const Vec3 local = s.axes.transpose() * (middle - s.position);
    for (int a = 0; a < 3; ++a) c[a] = static_cast<float>(local[a]);
  };
  for (std::size_t i = first + 2; i <= last; i += 2) {
    for (std::size_t f = 0; f < facets_.size(); ++f) {
      const FacetPlace &a = places_[(i - 2) * facets_.size() + f],
                       &b = places_[i * facets_.size() + f];
      float ca[3], cb[3];
      coordinates(a, ca);
      coordinates(b, cb);
      const Facet& facet = facets_[f];
      if (!may_cut(ca, a.half_range, cb, b.half_range, facet.low / voxel_size_m,
                   facet.high / voxel_size_m))
        continue;
      strokes_.push_back({f, i});
    }
  }
}

/// Digs all strokes of one chunk: the CSG difference with the sweep. Soil stays where
/// max(soil, -sweep) < 0, decided at 64 points of each voxel instead of at its centre.
/// @return true if a sample was removed
bool Excavator::dig(std::size_t edit, Samples& samples, Samples& loose, double h) {
  const Booking through_mouth = facets_.size() > 1 ? Booking::kCapturedAhead : Booking::kCaptured;
  const Coord3& origin = edits_[edit].origin;
  Work& work = work_[edit];
  for (std::size_t i = work.first; i < work.last; ++i) {
    const auto [f, pose] = strokes_[i];
    const Stroke stroke(frame(pose - 2, f, origin), frame(pose - 1, f, origin),
                        frame(pose, f, origin), facets_[f], h);
    const Booking booking = f == 0 ? through_mouth : Booking::kDisplaced;
    work.cut += cut_samples(samples, loose, origin, stroke, facets_[f], h, booking);
  }
  return work.cut.all.sum() > 0;
}

/// Digs the path from its pose `first` to `last`.
void Excavator::sweep_part(Ground& ground, std::size_t first, std::size_t last, Cut& cut) {
  Eigen::AlignedBox3d whole;
  for (std::size_t i = first; i <= last; ++i) whole.extend(box(i));
  // A bend, a parabola, leaves the hull of its ends and middle by a quarter of it.
  const Vec3 bulge = Vec3::Constant(kMaxBend / 4);
  whole = {whole.min() - bulge, whole.max() + bulge};
  if (ground.is_air(in_world(ground, whole))) return;
  const double h = ground.voxel_size_m();
  strokes_.clear();
  work_.clear();
  edits_.clear();
  for_each_chunk(whole, [&](const Coord3& origin) {
    const std::size_t before = strokes_.size();
    find_strokes(origin, first, last, h);
    if (strokes_.size() == before) return;
    edits_.push_back({origin, strokes_.size() - before});
    work_.push_back({before, strokes_.size(), {}});
  });
  GroundWriter(ground).edit(
      GroundWriter::Operation::kRemove, edits_, kParallelCutWork,
      [&](std::size_t i, Samples& samples, Samples& loose) { return dig(i, samples, loose, h); });
  for (const Work& work : work_) cut += work.cut;
}

void Excavator::find_places(const Ground& ground, std::span<const Pose> path) {
  places_.clear();
  for (const Pose& pose : path) {
    for (const Facet& facet : facets_) places_.push_back(place(ground, facet, pose));
  }
}

void Excavator::require_ground(const Ground& ground, std::span<const Pose> path) {
  if (bucket_.shape) return soilvdb::require_ground(ground, *bucket_.shape, path);
  if (path.size() == 1 && bucket_.profile.empty()) return;
  find_places(ground, path);
  require_known(ground, path);
}

Cut Excavator::cut_by_shape(Ground& ground, std::span<const Pose> path) const {
  soilvdb::require_ground(ground, *bucket_.shape, path);
  const ToolCut by_tool = subtract_traced(ground, *bucket_.shape, path);
  Cut cut;
  cut.all.displaced = by_tool.samples;
  cut.loose.displaced = by_tool.loose;
  return cut;
}

Cut Excavator::sweep(Ground& ground, std::span<const Pose> path) {
  Cut cut;
  if (path.size() < 2) return cut;
  if (bucket_.shape) return cut_by_shape(ground, path);
  find_places(ground, path);
  require_known(ground, path);
  for (std::size_t first = 0; first + 2 < path.size();) {
    std::size_t last = first + 2;
    Eigen::AlignedBox3d whole = box(first).merged(box(last));
    while (last + 2 < path.size()) {
      const Eigen::AlignedBox3d more = whole.merged(box(last + 2));
      if (chunks_in(more) > kMaxPartChunks) break;
      whole = more;
      last += 2;
    }
    sweep_part(ground, first, last, cut);
    first = last;
  }
  return cut;
}

/// Removes the samples inside the body from a chunk. @return their number
std::int64_t Excavator::clear_body(Samples& samples, const Coord3& origin, const Ground& ground,
                                   const Pose& bucket_from_world) const {
  std::int64_t removed = 0;
  for (int n = 0; n < kChunkVoxels; ++n) {
    const std::uint64_t word = samples.word(n);
    if (word == 0) continue;
    const Coord3 voxel = origin + numbered_voxel(n);
    const CellPoints& points = sample_points(voxel);
    const Vec3 low = voxel.cast<double>() - Vec3::Constant(0.5);
    std::uint64_t hit = 0;
    for (int i = 0; i < 64; ++i) {
      const Vec3 p = bucket_from_world *
                     ground.world_from_index(low + Vec3(points.x[i], points.y[i], points.z[i]));
      const bool in =
          std::abs(p.y()) <= bucket_.width_m / 2 && inside(bucket_.profile, {p.x(), p.z()});
      hit |= std::uint64_t{in} << i;
    }
    hit &= word;
    removed += std::popcount(hit);
    samples.set_word(n, word ^ hit);
  }
  return removed;
}

Cut Excavator::stamp(Ground& ground, const Pose& world_from_bucket) {
  Cut cut;
  if (bucket_.shape) return cut_by_shape(ground, {&world_from_bucket, 1});
  if (bucket_.profile.empty()) return cut;
  require_known(ground, {&world_from_bucket, 1});
  places_.clear();
  for (const Facet& facet : facets_) places_.push_back(place(ground, facet, world_from_bucket));
  const Pose bucket_from_world = world_from_bucket.inverse();
  edits_.clear();
  for_each_chunk(box(0), [&](const Coord3& origin) { edits_.push_back({origin}); });
  std::vector<Cut> cuts(edits_.size());
  const auto clear = [&](std::size_t e, Samples& samples, Samples& loose) {
    const auto clear_of = [&](Samples& of) {
      return clear_body(of, edits_[e].origin, ground, bucket_from_world);
    };
    cuts[e].all.displaced = clear_of(samples);
    cuts[e].loose.displaced = clear_of(loose);
    return cuts[e].all.displaced > 0;
  };
  GroundWriter(ground).edit(GroundWriter::Operation::kRemove, edits_, kParallelCutWork, clear);
  for (const Cut& part : cuts) cut += part;
  return cut;
}

}  // namespace soilvdb::inline v0
