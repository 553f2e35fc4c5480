// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cut_surface.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "core/chunk_range.h"
#include "core/sweep_distance.h"

namespace soilvdb {
namespace {

constexpr float kMiddle = 0.5f * kLeafSide;
/// Of a chunk's voxel centres from its middle, along each axis, voxels.
constexpr float kReach = 0.5f * (kLeafSide - 1);
/// Chunks below which one thread is quicker than two.
constexpr std::size_t kParallelChunks = 8;
/// Chunks in the box about a whole path up to which each of them is looked at.
constexpr double kFewChunks = 1000;
/// A trail that bends by less leaves no gap that matters: 0.5 % of the distance.
constexpr double kSmallBend_rad = 0.2;

}  // namespace

/// The poses and segments near a chunk; scratch.
struct SurfaceCut::Near {
  std::vector<AffineFrame> frames;             // of the bucket at each pose
  std::vector<std::uint32_t> crossing, close;  // segments by their first pose; poses
  std::vector<std::uint32_t> mouths, bodies;   // poses near which distances change
  std::uint32_t rows[kLeafSide];               // bit y of rows[x]: near the mouth
};

SurfaceCut::SurfaceCut(const Soil& soil, const Bucket& bucket, const SweepWindow& window,
                       std::vector<Coord3> chunks)
    : sweep_(bucket, soil.voxel_size_m()),
      mouth_(window.mouth && window.world_from_bucket.size() > 1),
      body_(window.body && !bucket.profile.empty()),
      fresh_(window.fresh),
      begins_(window.begins),
      chunks_(std::move(chunks)) {
  const auto& path = window.world_from_bucket;
  for (const Pose& pose : path) {
    axes_.push_back(pose.rotation.toRotationMatrix());
    positions_.push_back(soil.index_from_world(pose.position));
  }
  for (std::size_t i = 1; i < axes_.size(); ++i) advances_.push_back(advance(i));
  const auto corners = mouth_corners(bucket);
  for (std::size_t i = 0; i < axes_.size(); ++i)
    bounds_.push_back(bounds(i, corners, soil.voxel_size_m()));
  for (std::size_t i = 1; i < path.size(); ++i) {
    const double step = travel(bucket, path[i - 1], path[i]) / soil.voxel_size_m();
    spacing_ = std::max(spacing_, static_cast<float>(step) / 2);
  }
  if (window.begins) return;
  double from_back = 0;
  while (settled_ + 1 < path.size() && settled_ < fresh_ && from_back < soil.band_m()) {
    from_back += travel(bucket, path[settled_], path[settled_ + 1]);
    ++settled_;
  }
}

SurfaceCut::SurfaceCut(const Soil& soil, const Bucket& bucket, const SweepWindow& window)
    : SurfaceCut(soil, bucket, window, {}) {
  find_chunks(soil, bucket);
}

/// Distances change within the band of the fresh segments.
void SurfaceCut::find_chunks(const Soil& soil, const Bucket& bucket) {
  const auto mouth = mouth_corners(bucket);
  const std::vector<Vec3> corners =
      body_ ? extremes(bucket) : std::vector<Vec3>(mouth.begin(), mouth.end());
  std::vector<Eigen::AlignedBox3d> boxes(axes_.size());
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    for (const Vec3& p : corners)
      boxes[i].extend(positions_[i] + axes_[i] * p / soil.voxel_size_m());
  }
  Eigen::AlignedBox3d whole;
  for (std::size_t i = changing(); i < boxes.size(); ++i) {
    boxes[i].min().array() -= kBandVoxels;
    boxes[i].max().array() += kBandVoxels;
    whole.extend(boxes[i]);
  }
  const auto add = [&](const Coord3& origin) { chunks_.push_back(origin); };
  if (((whole.sizes() / kLeafSide).array() + 1).prod() <= kFewChunks) {
    for_each_chunk(whole, add);
  } else {
    for (std::size_t i = changing(); i + 1 < boxes.size(); ++i)
      for_each_chunk(boxes[i].merged(boxes[i + 1]), add);
    std::sort(chunks_.begin(), chunks_.end(), before);
    chunks_.erase(std::unique(chunks_.begin(), chunks_.end()), chunks_.end());
  }
  Near near;
  std::erase_if(chunks_, [&](const Coord3& origin) {
    if (const Chunk* chunk = soil.find(origin)) return chunk->air || !find_near(origin, near);
    // Air, but maybe within the band of the ground.
    const Vec3 wide = Vec3::Constant(soil.band_m());
    const Vec3 low = soil.world_from_index(origin.cast<double>());
    const Vec3 high = soil.world_from_index((origin + Coord3::Constant(kLeafSide)).cast<double>());
    return soil.base().classify({low - wide, high + wide}) == Content::kAir ||
           !find_near(origin, near);
  });
}

Advance SurfaceCut::advance(std::size_t i) const {
  const Vec3 normal = axes_[i].col(0);
  const Eigen::Matrix3d turn = axes_[i] - axes_[i - 1];
  return {static_cast<float>(normal.dot(positions_[i] - positions_[i - 1])),
          static_cast<float>(normal.dot(turn.col(1))), static_cast<float>(normal.dot(turn.col(2)))};
}

Bounds SurfaceCut::bounds(std::size_t i, std::span<const Vec3> corners, double h) const {
  if (i == 0) return {begins_, begins_, begins_};
  if (i + 1 == axes_.size()) return {true, true, true};
  Bounds b;
  bool ahead = true, back = true;
  for (const Vec3& corner : corners) {
    const Vec3 p = corner / h;
    const auto along = [&](std::size_t j) {
      return Vec3(positions_[j] - positions_[j - 1] + (axes_[j] - axes_[j - 1]) * p);
    };
    const Vec3 from = along(i), to = along(i + 1);
    const float y = static_cast<float>(p.y()), z = static_cast<float>(p.z());
    for (const Advance& a : {advances_[i - 1], advances_[i]}) {
      (a.at(y, z) > 0 ? back : ahead) = false;
    }
    b.bends |= from.cross(to).norm() > kSmallBend_rad * from.norm() * to.norm() || from.dot(to) < 0;
  }
  b.stops = !ahead && !back;
  return b;
}

void SurfaceCut::carve(Soil& soil, std::size_t count) {
  const std::size_t from = done_;
  count = std::min(count, pending().size());
  done_ += count;
  const auto run = [&](std::size_t i) {
    thread_local Near near;
    const Coord3& origin = chunks_[from + i];
    Chunk* const chunk = soil.find(origin);
    if ((chunk != nullptr && chunk->air) || !find_near(origin, near) || !find_rows(near)) return;
    if (chunk != nullptr) soil.warm(*chunk);
    Phi phi;
    if (chunk != nullptr && chunk->phi) {
      chunk->phi.expand(phi);
      if (carve_chunk(near, phi)) soil.set_phi(soil.make(origin), phi);
      return;
    }
    // What phi is there must be made from the base surface: first see what for.
    phi.fill(-kPhiMax);
    if (!carve_chunk(near, phi)) return;
    Phi base;
    soil.read_phi(origin, base);
    bool changed = false;
    for (int n = 0; n < kLeafSize; ++n) {
      changed |= phi[n] > base[n];
      phi[n] = std::max(phi[n], base[n]);
    }
    if (changed) {
      soil.set_phi(soil.make(origin), phi);
    } else if (chunk != nullptr) {
      soil.set_phi(*chunk, phi);  // as it was, but made: it will be asked for again
    }
  };
  if (count >= kParallelChunks) {
    tbb::parallel_for(std::size_t{0}, count, run);
  } else {
    for (std::size_t i = 0; i < count; ++i) run(i);
  }
}

/// Finds what may change a chunk's phi. @return whether anything may
bool SurfaceCut::find_near(const Coord3& origin, Near& near) const {
  const std::size_t poses = axes_.size();
  near.frames.clear();
  near.crossing.clear();
  near.close.clear();
  near.mouths.clear();
  near.bodies.clear();
  constexpr float kBand2 = kBandVoxels * kBandVoxels;
  const float wide2 = (kBandVoxels + spacing_) * (kBandVoxels + spacing_);
  float u = 0, u_reach = 0;
  for (std::size_t i = 0; i < poses; ++i) {
    const AffineFrame& frame = near.frames.emplace_back(axes_[i], positions_[i], origin);
    float p[3], reach[3];
    for (int a = 0; a < 3; ++a) {
      p[a] = frame.axis[a].at(kMiddle, kMiddle, kMiddle);
      reach[a] = frame.axis[a].reach(kReach, kReach, kReach);
    }
    if (mouth_ && i > 0 &&
        !((u > u_reach && p[0] > reach[0]) || (u < -u_reach && p[0] < -reach[0])))
      near.crossing.push_back(static_cast<std::uint32_t>(i - 1));
    u = p[0];
    u_reach = reach[0];
    const float to_mouth2 = sweep_.to_mouth2(p, reach);
    if (mouth_ && i >= changing() && to_mouth2 < wide2)
      near.mouths.push_back(static_cast<std::uint32_t>(i));
    if (mouth_ && to_mouth2 < kBand2 && (bounds_[i].always || bounds_[i].stops || bounds_[i].bends))
      near.close.push_back(static_cast<std::uint32_t>(i));
    if (body_ && i >= fresh_ && sweep_.to_body2(p, reach) < kBand2)
      near.bodies.push_back(static_cast<std::uint32_t>(i));
  }
  if (near.mouths.empty()) {
    near.crossing.clear();
    near.close.clear();
  }
  return !near.crossing.empty() || !near.close.empty() || !near.bodies.empty();
}

/// Finds the rows of the chunk near the mouth. @return whether anything may change
bool SurfaceCut::find_rows(Near& near) const {
  std::uint32_t any = 0;
  for (int i = 0; i < kLeafSide; ++i) {
    near.rows[i] = 0;
    if (!near.crossing.empty() || !near.close.empty())
      near.rows[i] =
          sweep_.rows_near_mouth(near.frames, near.mouths, static_cast<float>(i) + 0.5f, spacing_);
    any |= near.rows[i];
  }
  return any != 0 || !near.bodies.empty();
}

bool SurfaceCut::carve_chunk(const Near& near, Phi& phi) const {
  const SweptMouth mouth{near.frames, near.crossing, near.close, advances_, bounds_, settled_};
  bool changed = false;
  for (int i = 0; i < kLeafSide; ++i) {
    if (near.rows[i] == 0 && near.bodies.empty()) continue;
    const float x = static_cast<float>(i) + 0.5f;
    std::int16_t* slab = &phi[static_cast<std::size_t>(kLeafSide * kLeafSide * i)];
    std::uint32_t soil = 0;  // rows that aren't all air
    for (int j = 0; j < kLeafSide; ++j) {
      const std::int16_t* row = slab + kLeafSide * j;
      const bool air = std::all_of(row, row + kLeafSide, [](int v) { return v == kPhiMax; });
      soil |= std::uint32_t{!air} << j;
    }
    if ((near.rows[i] & soil) != 0)
      changed |= sweep_.carve_by_mouth(mouth, x, near.rows[i] & soil, slab);
    for (const std::uint32_t pose : near.bodies) {
      for (int j = 0; j < kLeafSide; ++j) {
        if ((soil >> j & 1) == 0) continue;
        const float y = static_cast<float>(j) + 0.5f;
        changed |= sweep_.carve_by_body(near.frames[pose], x, y, slab + kLeafSide * j);
      }
    }
  }
  return changed;
}

}  // namespace soilvdb
