// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cut_surface.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/affine.h"
#include "core/chunk_range.h"
#include "core/polygon.h"

namespace soilvdb {
namespace {

constexpr float kFar = std::numeric_limits<float>::max();
constexpr float kHalf = 0.5f * kLeafSide;
/// Chunks below which one thread is quicker than two.
constexpr std::size_t kParallelChunks = 8;

/// phi = max(phi, value). @return whether it changed.
bool raise(float& phi, float value) {
  if (!(value > phi)) return false;
  phi = value;
  return true;
}

/// Distance from a point in the bucket frame to the mouth, all in voxels.
float distance_to_mouth(const float* p, float half_width, float height) {
  const float dy = std::max(std::abs(p[1]) - half_width, 0.0f);
  const float dz = std::max(std::max(-p[2], p[2] - height), 0.0f);
  return std::sqrt(p[0] * p[0] + dy * dy + dz * dz);
}

/// Signed distance to the surface that the mouth's edges trail, of a point which the mouth's plane
/// passes on its way from bucket coordinates a to b: how far it is beyond the edge at the crossing,
/// over the length of the gradient of that, sqrt(1 + (dy/dx)^2) or sqrt(1 + (dz/dx)^2).
float distance_to_trail(const float* a, const float* b, float half_width, float height) {
  const float dx = b[0] - a[0], dy = b[1] - a[1], dz = b[2] - a[2];
  const float f = a[0] / (a[0] - b[0]);
  const float y = a[1] + f * dy, z = a[2] + f * dz;
  const float ey = (std::abs(y) - half_width) * std::abs(dx) / std::sqrt(dx * dx + dy * dy);
  const float ez = std::max(-z, z - height) * std::abs(dx) / std::sqrt(dx * dx + dz * dz);
  return ey > 0 && ez > 0 ? std::sqrt(ey * ey + ez * ez) : std::max(ey, ez);
}

}  // namespace

SurfaceCut::SurfaceCut(const Soil& soil, const Bucket& bucket, const SweepWindow& window)
    : bucket_(bucket),
      mouth_(window.mouth && window.world_from_bucket.size() > 1),
      body_(window.body && !bucket.profile.empty()),
      half_width_(static_cast<float>(bucket.width_m / 2 / soil.voxel_size_m())),
      height_(static_cast<float>(bucket.height_m / soil.voxel_size_m())),
      h_(static_cast<float>(soil.voxel_size_m())),
      band_(static_cast<float>(soil.band_m())),
      fresh_(window.fresh),
      begins_(window.begins) {
  const double margin = soil.band_m() / soil.voxel_size_m();
  const auto mouth = mouth_corners(bucket);
  std::vector<Vec3> corners(mouth.begin(), mouth.end());
  if (body_) {
    for (const Vec2& p : bucket.profile) {
      for (const double side : {-0.5, 0.5})
        corners.emplace_back(p.x(), side * bucket.width_m, p.y());
    }
  }
  // New distances are found along the fresh segments, and behind them as far as the band reaches.
  std::vector<Eigen::AlignedBox3d> boxes;
  for (const Pose& pose : window.world_from_bucket) {
    axes_.push_back(pose.rotation.toRotationMatrix());
    positions_.push_back(soil.index_from_world(pose.position));
    Eigen::AlignedBox3d& box = boxes.emplace_back();
    for (const Vec3& p : corners) box.extend(soil.index_from_world(pose * p));
  }
  for (std::size_t i = 1; i < axes_.size(); ++i) advances_.push_back(advance(i));
  if (!window.begins) {
    const auto& poses = window.world_from_bucket;
    double from_back = 0;
    while (settled_ + 1 < poses.size() && settled_ < fresh_ && from_back < soil.band_m()) {
      from_back += travel(bucket, poses[settled_], poses[settled_ + 1]);
      ++settled_;
    }
  }
  double behind = 0;
  for (std::size_t i = boxes.size(); i-- > 0;) {
    if (i < fresh_) {
      behind += (positions_[i + 1] - positions_[i]).norm();
      if (behind > margin) break;
    }
    Eigen::AlignedBox3d box = boxes[i];
    if (i + 1 < boxes.size()) box.extend(boxes[i + 1]);
    const Vec3 wide = Vec3::Constant(margin);
    for_each_chunk({box.min() - wide, box.max() + wide},
                   [&](const Coord3& origin) { chunks_.push_back(origin); });
  }
  std::sort(chunks_.begin(), chunks_.end(), before);
  chunks_.erase(std::unique(chunks_.begin(), chunks_.end()), chunks_.end());
  std::erase_if(chunks_, [&](const Coord3& origin) {
    if (soil.find(origin) != nullptr) return false;
    // Air, but maybe within the band of the ground.
    const Vec3 wide = Vec3::Constant(soil.band_m());
    const Vec3 low = soil.world_from_index(origin.cast<double>());
    const Vec3 high = soil.world_from_index((origin + Coord3::Constant(kLeafSide)).cast<double>());
    return soil.base().classify({low - wide, high + wide}) == Content::kAir;
  });
}

SurfaceCut::Advance SurfaceCut::advance(std::size_t i) const {
  const Vec3 normal = axes_[i].col(0);
  const Eigen::Matrix3d turn = axes_[i] - axes_[i - 1];
  return {static_cast<float>(normal.dot(positions_[i] - positions_[i - 1])),
          static_cast<float>(normal.dot(turn.col(1))), static_cast<float>(normal.dot(turn.col(2)))};
}

bool SurfaceCut::stops(std::size_t i, float y, float z) const {
  if (i == 0) return begins_;
  if (i + 1 == axes_.size()) return true;
  y = std::clamp(y, -half_width_, half_width_);
  z = std::clamp(z, 0.0f, height_);
  return (advances_[i - 1].at(y, z) > 0) != (advances_[i].at(y, z) > 0);
}

void SurfaceCut::carve(Soil& soil, std::size_t count, std::vector<Coord3>& changed) {
  const std::size_t from = done_;
  count = std::min(count, pending().size());
  done_ += count;
  std::vector<std::uint8_t> touched(count);
  const auto run = [&](std::size_t i) {
    const Coord3& origin = chunks_[from + i];
    if (Chunk* chunk = soil.find(origin)) {
      touched[i] = carve_chunk(origin, chunk->phi);
      if (touched[i]) soil.phi_changed(*chunk);
    } else {
      std::array<float, kLeafSize> phi;
      soil.read_phi(origin, phi.data());
      touched[i] = carve_chunk(origin, phi.data());
    }
  };
  if (count >= kParallelChunks) {
    tbb::parallel_for(std::size_t{0}, count, run);
  } else {
    for (std::size_t i = 0; i < count; ++i) run(i);
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (!touched[i]) continue;
    const Coord3& origin = chunks_[from + i];
    changed.push_back(origin);
    if (soil.find(origin) == nullptr) {
      Chunk& chunk = soil.make(origin);
      carve_chunk(origin, chunk.phi);
      soil.phi_changed(chunk);
    }
  }
}

bool SurfaceCut::carve_chunk(const Coord3& origin, float* phi) const {
  if (*std::min_element(phi, phi + kLeafSize) >= band_) return false;
  bool changed = mouth_ && carve_mouth(origin, phi);
  if (body_) changed |= carve_body(origin, phi);
  return changed;
}

bool SurfaceCut::carve_mouth(const Coord3& origin, float* phi) const {
  const std::size_t poses = axes_.size();
  thread_local std::vector<AffineFrame> frames;
  thread_local std::vector<float> at_row, reach, row_reach;
  thread_local std::vector<std::size_t> near, crossing;  // segments by their first pose
  frames.clear();
  at_row.resize(poses);
  reach.resize(poses);
  row_reach.resize(poses);
  for (std::size_t i = 0; i < poses; ++i) {
    const Affine& x = frames.emplace_back(axes_[i], positions_[i], origin).axis[0];
    reach[i] = x.reach(kHalf, kHalf, kHalf);
    row_reach[i] = x.reach(0, 0, kHalf);
    at_row[i] = x.at(kHalf, kHalf, kHalf);
  }
  const auto may_cross = [&](std::size_t i, const std::vector<float>& r) {
    const float u = at_row[i], v = at_row[i + 1];
    return !((u > r[i] && v > r[i + 1]) || (u < -r[i] && v < -r[i + 1]));
  };
  near.clear();
  for (std::size_t i = 0; i + 1 < poses; ++i) {
    if (may_cross(i, reach)) near.push_back(i);
  }
  // Distance to the mouth at a pose.
  const auto to_mouth = [&](std::size_t i, float x, float y, float z) {
    const AffineFrame& f = frames[i];
    const float p[3] = {f.axis[0].at(x, y, z), f.axis[1].at(x, y, z), f.axis[2].at(x, y, z)};
    return distance_to_mouth(p, half_width_, height_);
  };
  // How far ahead of a point the mouth was at most, before it came back over it in segment i.
  const auto farthest_before = [&](std::size_t i, float x, float y, float z) {
    float most = 0;
    for (std::size_t j = i + 1; j-- > 0;) {
      const float at = -frames[j].axis[0].at(x, y, z);
      if (at < 0) break;
      most = std::max(most, at);
    }
    return most;
  };
  const float band = band_ / h_;
  thread_local std::vector<std::size_t> close, row_close;  // poses
  close.clear();
  for (std::size_t i = 0; i < poses; ++i) {
    if (to_mouth(i, kHalf, kHalf, kHalf) < band + 1.75f * kHalf) close.push_back(i);
  }
  if (near.empty() && close.empty()) return false;

  bool changed = false;
  for (int n = 0; n < kLeafSize; n += kLeafSide) {
    float* row = phi + n;
    if (*std::min_element(row, row + kLeafSide) >= band_) continue;
    const float x = static_cast<float>(n >> 6) + 0.5f, y = static_cast<float>(n >> 3 & 7) + 0.5f;
    for (const std::size_t i : near) {
      at_row[i] = frames[i].axis[0].at(x, y, kHalf);
      at_row[i + 1] = frames[i + 1].axis[0].at(x, y, kHalf);
    }
    crossing.clear();
    for (const std::size_t i : near) {
      if (may_cross(i, row_reach)) crossing.push_back(i);
    }
    row_close.clear();
    for (const std::size_t i : close) {
      if (to_mouth(i, x, y, kHalf) < band + kHalf) row_close.push_back(i);
    }
    if (crossing.empty() && row_close.empty()) continue;
    for (int k = 0; k < kLeafSide; ++k) {
      if (row[k] >= band_) continue;
      const float z = static_cast<float>(k) + 0.5f;
      float trail = kFar, gone = kFar;
      bool leave = false;
      for (const std::size_t i : crossing) {
        const AffineFrame &f = frames[i], &g = frames[i + 1];
        const float u = f.axis[0].at(x, y, z), v = g.axis[0].at(x, y, z);
        if ((u > 0) == (v > 0)) continue;
        const float a[3] = {u, f.axis[1].at(x, y, z), f.axis[2].at(x, y, z)};
        const float b[3] = {v, g.axis[1].at(x, y, z), g.axis[2].at(x, y, z)};
        const float side = distance_to_trail(a, b, half_width_, height_);
        leave |= side < 0 && i < settled_;
        if (u <= 0) gone = std::min(gone, farthest_before(i, x, y, z));
        trail = std::min(trail, side);
      }
      if (leave) continue;
      float mouth = kFar;
      for (const std::size_t i : row_close) {
        const AffineFrame& f = frames[i];
        if (trail < 0 && !stops(i, f.axis[1].at(x, y, z), f.axis[2].at(x, y, z))) continue;
        mouth = std::min(mouth, to_mouth(i, x, y, z));
      }
      const float distance = trail < 0 ? -std::min({-trail, mouth, gone}) : std::min(trail, mouth);
      if (distance < band) changed |= raise(row[k], std::min(-distance * h_, band_));
    }
  }
  return changed;
}

bool SurfaceCut::carve_body(const Coord3& origin, float* phi) const {
  bool changed = false;
  const double h = h_;
  for (std::size_t i = fresh_; i < axes_.size(); ++i) {
    for (int n = 0; n < kLeafSize; ++n) {
      if (phi[n] >= band_) continue;
      const Vec3 voxel = (origin + Coord3(n >> 6, n >> 3 & 7, n & 7)).cast<double>();
      const Vec3 p = h * (axes_[i].transpose() * (voxel - positions_[i]));
      const double outline = signed_distance(bucket_.profile, {p.x(), p.z()});
      const double side = std::abs(p.y()) - bucket_.width_m / 2;
      const double d =
          outline > 0 && side > 0 ? std::hypot(outline, side) : std::max(outline, side);
      changed |= raise(phi[n], std::clamp(static_cast<float>(-d), -band_, band_));
    }
  }
  return changed;
}

}  // namespace soilvdb
