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
/// Chunks below which one thread is quicker than two.
constexpr std::size_t kParallelChunks = 8;

/// The mouth in voxels.
struct Mouth {
  float half_width, height;

  /// Distance to the rectangle from a point in the bucket frame.
  float distance(float x, float y, float z) const {
    const float dy = std::max(std::abs(y) - half_width, 0.0f);
    const float dz = std::max(std::max(-z, z - height), 0.0f);
    return std::sqrt(x * x + dy * dy + dz * dz);
  }

  /// Signed distance across the path to the surface the mouth's edges trail, of a point that the
  /// mouth's plane crosses on the way from bucket coordinates a to b: the coordinate beyond the
  /// edge at the crossing, over the length of its gradient, 1 + (dy/dx)^2 or 1 + (dz/dx)^2.
  float lateral(const float* a, const float* b) const {
    const float dx = b[0] - a[0], dy = b[1] - a[1], dz = b[2] - a[2];
    const float f = a[0] / (a[0] - b[0]);
    const float y = a[1] + f * dy, z = a[2] + f * dz;
    const float ey = (std::abs(y) - half_width) * std::abs(dx) / std::sqrt(dx * dx + dy * dy);
    const float ez = std::max(-z, z - height) * std::abs(dx) / std::sqrt(dx * dx + dz * dz);
    return ey > 0 && ez > 0 ? std::sqrt(ey * ey + ez * ez) : std::max(ey, ez);
  }
};

/// Lowers nothing: phi = max(phi, value). @return whether it changed.
bool raise(float& phi, float value) {
  if (!(value > phi)) return false;
  phi = value;
  return true;
}

/// The window over one chunk: which segments may cross it, and the frames at their ends.
struct LocalWindow {
  std::vector<AffineFrame> frames;
  std::vector<std::uint8_t> crosses;   // segment i, between frames i and i + 1
};

/// Poses at which part of the mouth stops to turn back, and the window's ends: there the mouth
/// itself bounds what it swept.
std::vector<std::size_t> stops(std::span<const Pose> poses, const Bucket& bucket, bool begins) {
  std::vector<std::size_t> all;
  if (begins) all.push_back(0);
  for (std::size_t i = 1; i + 1 < poses.size(); ++i) {
    const Vec3 normal = poses[i].rotation * Vec3::UnitX();
    for (const double y : {-bucket.width_m / 2, bucket.width_m / 2}) {
      for (const double z : {0.0, bucket.height_m}) {
        const Vec3 p(0, y, z), at = poses[i] * p;
        const double in = normal.dot(at - poses[i - 1] * p), out = normal.dot(poses[i + 1] * p - at);
        if (in * out < 0 && (all.empty() || all.back() != i)) all.push_back(i);
      }
    }
  }
  all.push_back(poses.size() - 1);
  return all;
}

bool cut_chunk(float* phi, const LocalWindow& window, const Mouth& mouth,
               const std::vector<std::size_t>& stops, float h, float band) {
  bool changed = false;
  const std::size_t last = window.frames.size() - 1;
  std::array<float, 3> a{}, b{};
  for (int n = 0; n < kLeafSize; ++n) {
    if (phi[n] >= band) continue;
    const float x = static_cast<float>(n >> 6) + 0.5f, y = static_cast<float>(n >> 3 & 7) + 0.5f,
                z = static_cast<float>(n & 7) + 0.5f;
    const auto local = [&](std::size_t i, std::array<float, 3>& p) {
      const AffineFrame& f = window.frames[i];
      p = {f.x.at(x, y, z), f.y.at(x, y, z), f.z.at(x, y, z)};
    };
    float lateral = kFar;
    for (std::size_t i = 0; i < last; ++i) {
      if (!window.crosses[i]) continue;
      const float u = window.frames[i].x.at(x, y, z), v = window.frames[i + 1].x.at(x, y, z);
      if ((u > 0) == (v > 0)) continue;
      local(i, a);
      local(i + 1, b);
      lateral = std::min(lateral, mouth.lateral(a.data(), b.data()));
    }
    float ends = kFar;
    for (const std::size_t i : stops) {
      local(i, a);
      ends = std::min(ends, mouth.distance(a[0], a[1], a[2]));
    }
    const float distance = lateral < 0 ? -std::min(-lateral, ends) : std::min(lateral, ends);
    changed |= raise(phi[n], std::clamp(-distance * h, -band, band));
  }
  return changed;
}

/// Runs `carve(phi, origin)` on phi of each chunk in a box where there is soil, in parallel, and
/// puts back what it changed, making chunks where needed.
template <typename Carve>
std::vector<Coord3> carve_chunks(Soil& soil, const Eigen::AlignedBox3d& box, const Carve& carve) {
  struct Task {
    Coord3 origin;
    Chunk* chunk;
    bool changed = false;
  };
  std::vector<Task> tasks;
  for_each_chunk(box, [&](const Coord3& origin) {
    Chunk* chunk = soil.find(origin);
    if (chunk == nullptr && soil.classify(origin) == Content::kAir) return;
    tasks.push_back({origin, chunk});
  });
  const auto run = [&](std::size_t i) {
    Task& task = tasks[i];
    if (task.chunk != nullptr) {
      task.changed = carve(task.chunk->phi, task.origin);
      if (task.changed) soil.phi_changed(*task.chunk);
    } else {
      std::array<float, kLeafSize> phi;
      soil.read_phi(task.origin, phi.data());
      task.changed = carve(phi.data(), task.origin);
    }
  };
  if (tasks.size() >= kParallelChunks) {
    tbb::parallel_for(std::size_t{0}, tasks.size(), run);
  } else {
    for (std::size_t i = 0; i < tasks.size(); ++i) run(i);
  }
  std::vector<Coord3> changed;
  for (Task& task : tasks) {
    if (!task.changed) continue;
    changed.push_back(task.origin);
    if (task.chunk == nullptr) {
      Chunk& made = soil.make(task.origin);
      carve(made.phi, task.origin);
      soil.phi_changed(made);
    }
  }
  return changed;
}

Pose index_from_bucket(const Soil& soil, const Pose& world_from_bucket) {
  return {soil.index_from_world(world_from_bucket.position), world_from_bucket.rotation};
}

}  // namespace

std::vector<Coord3> cut_surface(Soil& soil, const Bucket& bucket, const SweepWindow& window) {
  const double h = soil.voxel_size_m();
  const float band = static_cast<float>(soil.band_m());
  const Mouth mouth{static_cast<float>(bucket.width_m / 2 / h), static_cast<float>(bucket.height_m / h)};
  std::vector<Pose> poses;
  Eigen::AlignedBox3d box;
  for (const Pose& pose : window.world_from_bucket) {
    poses.push_back(index_from_bucket(soil, pose));
    for (const double y : {-bucket.width_m / 2, bucket.width_m / 2}) {
      for (const double z : {0.0, bucket.height_m}) {
        box.extend(soil.index_from_world(pose * Vec3(0, y, z)));
      }
    }
  }
  if (poses.size() < 2) return {};
  const std::vector<std::size_t> ends = stops(window.world_from_bucket, bucket, window.begins);
  const Vec3 margin = Vec3::Constant(soil.band_m() / h);
  box = {box.min() - margin, box.max() + margin};

  return carve_chunks(soil, box, [&](float* phi, const Coord3& origin) {
    if (*std::min_element(phi, phi + kLeafSize) >= band) return false;
    thread_local LocalWindow local;
    local.frames.clear();
    local.crosses.assign(poses.size(), 0);
    const float mid = kLeafSide / 2.0f, half = kLeafSide / 2.0f;
    bool near = false;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      local.frames.emplace_back(poses[i], origin);
      const AffineFrame& f = local.frames.back();
      if (i == 0) continue;
      const AffineFrame& e = local.frames[i - 1];
      const float u = e.x.at(mid, mid, mid), v = f.x.at(mid, mid, mid);
      const float ru = e.x.reach(half), rv = f.x.reach(half);
      local.crosses[i - 1] = !((u > ru && v > rv) || (u < -ru && v < -rv));
      near |= local.crosses[i - 1] != 0;
    }
    const auto end_is_near = [&](const AffineFrame& f) {
      return mouth.distance(f.x.at(mid, mid, mid), f.y.at(mid, mid, mid), f.z.at(mid, mid, mid)) <
             band / static_cast<float>(h) + 1.75f * half;
    };
    for (const std::size_t i : ends) near |= end_is_near(local.frames[i]);
    return near && cut_chunk(phi, local, mouth, ends, static_cast<float>(h), band);
  });
}

std::vector<Coord3> cut_surface_by_body(Soil& soil, const Bucket& bucket,
                                        std::span<const Pose> world_from_bucket) {
  const double h = soil.voxel_size_m();
  const float band = static_cast<float>(soil.band_m());
  std::vector<Coord3> all;
  for (const Pose& pose : world_from_bucket) {
    const Pose bucket_from_world = pose.inverse();
    Eigen::AlignedBox3d box;
    for (const double y : {-bucket.width_m / 2, bucket.width_m / 2}) {
      for (const Vec2& p : bucket.profile) {
        box.extend(soil.index_from_world(pose * Vec3(p.x(), y, p.y())));
      }
    }
    const Vec3 margin = Vec3::Constant(soil.band_m() / h);
    box = {box.min() - margin, box.max() + margin};
    const auto changed = carve_chunks(soil, box, [&](float* phi, const Coord3& origin) {
      bool any = false;
      for (int n = 0; n < kLeafSize; ++n) {
        if (phi[n] >= band) continue;
        const Vec3 p = bucket_from_world * soil.world_from_index(
                                               (origin + Coord3(n >> 6, n >> 3 & 7, n & 7)).cast<double>());
        const double outline = signed_distance(bucket.profile, {p.x(), p.z()});
        const double side = std::abs(p.y()) - bucket.width_m / 2;
        const double d =
            outline > 0 && side > 0 ? std::hypot(outline, side) : std::max(outline, side);
        any |= raise(phi[n], std::clamp(static_cast<float>(-d), -band, band));
      }
      return any;
    });
    all.insert(all.end(), changed.begin(), changed.end());
  }
  std::sort(all.begin(), all.end(), before);
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

}  // namespace soilvdb
