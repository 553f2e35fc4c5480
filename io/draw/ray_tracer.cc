// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/draw/ray_tracer.h"

#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/RayIntersector.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <array>
#include <cmath>
#include <numbers>
#include <numeric>

namespace soilvdb::inline v0::io {
namespace {

using Vec3f = Eigen::Vector3f;

constexpr Rgb kSunLight{0.84, 0.80, 0.73}, kSkyLight{0.58, 0.61, 0.68};
constexpr Rgb kBackgroundTop{0.995, 0.995, 0.995}, kBackgroundFoot{0.915, 0.925, 0.94};
constexpr int kTile = 4;                     // sky directions repeat every 4 x 4 pixels,
constexpr int kSkyRays = kTile * kTile * 4;  // one for each of their four rays

Vec3f linear(const Rgb& c) {
  return {static_cast<float>(std::pow(c.r, 2.2)), static_cast<float>(std::pow(c.g, 2.2)),
          static_cast<float>(std::pow(c.b, 2.2))};
}
Vec3f plain(const Rgb& c) { return Vec3(c.r, c.g, c.b).cast<float>(); }

/// Casts rays from one thread.
///
/// OpenVDB's ray search samples where a ray crosses a voxel border. It misses corners between two
/// samples, so edges look toothed. This search first finds a shell kShell voxels outside the
/// ground, which no ray can miss, and takes small steps from there.
class Caster {
 public:
  explicit Caster(const Scene& scene)
      : scene_(scene),
        ground_(*scene.ground),
        voxel_(static_cast<float>(ground_.voxelSize().x())),
        intersector_(ground_, kShell * voxel_),
        values_(ground_.getConstAccessor()) {}

  bool hit(const Vec3& eye, const Vec3& direction, Vec3& point, Vec3& normal) const {
    // The ground continues beyond the block, and rays enter through the block's sides. A level set
    // interpolated there would round these sides.
    double from = 0;
    int side = 0;
    for (int a = 0; a < 3; ++a) {
      const double t = ((direction[a] > 0 ? scene_.low : scene_.high)[a] - eye[a]) / direction[a];
      if (std::isfinite(t) && t > from) {
        from = t;
        side = a;
      }
    }
    point = eye + from * direction;
    if (!in_block(point)) return false;
    openvdb::Vec3d at = index(point);
    if (from > 0 && distance(at) <= 0) {
      normal = (direction[side] > 0 ? -1 : 1) * Vec3::Unit(side);
      return true;
    }
    if (!march(at, {direction.x(), direction.y(), direction.z()})) return false;
    point = world(at);
    normal = gradient(at);
    return in_block(point);
  }

  /// Does ground stand between a point of the surface and the sky?
  bool shaded(const Vec3& point, const Vec3& normal, const Vec3& direction) const {
    openvdb::Vec3d at = index(point) + 1.2 * openvdb::Vec3d(normal.x(), normal.y(), normal.z());
    return march(at, {direction.x(), direction.y(), direction.z()}) && in_block(world(at));
  }

 private:
  using Intersector = openvdb::tools::LevelSetRayIntersector<openvdb::FloatGrid>;
  static constexpr float kShell = 0.8f;  // voxels

  openvdb::Vec3d index(const Vec3& p) const {
    return ground_.worldToIndex(openvdb::Vec3d(p.x(), p.y(), p.z()));
  }
  Vec3 world(const openvdb::Vec3d& at) const {
    const openvdb::Vec3d p = ground_.indexToWorld(at);
    return {p.x(), p.y(), p.z()};
  }
  bool in_block(const Vec3& p) const {
    const double rounding = 1e-6 * (scene_.high - scene_.low).norm();
    return (p.array() >= scene_.low.array() - rounding).all() &&
           (p.array() <= scene_.high.array() + rounding).all();
  }
  /// Distance to the ground, voxels.
  double distance(const openvdb::Vec3d& at) const {
    return openvdb::tools::BoxSampler::sample(values_, at) / voxel_;
  }
  /// Moves `at` (index space) along a unit direction to the ground; false if the ray misses it.
  bool march(openvdb::Vec3d& at, const openvdb::Vec3d& direction) const {
    double before = distance(at), step = 0;
    for (int i = 0; i < 1000; ++i) {
      if (before > kShell + 0.1) {
        openvdb::Vec3d entry;
        if (!intersector_.intersectsIS(Intersector::RayType(at, direction), entry)) return false;
        at = entry;
        before = distance(at);
      }
      if (before <= 0) return true;
      step = std::max(0.2, before);
      at += step * direction;
      const double now = distance(at);
      if (now <= 0) {
        at -= step * now / (now - before) * direction;
        return true;
      }
      before = now;
    }
    return false;
  }
  /// Central differences over a voxel; the trilinear gradient alone shows every voxel.
  Vec3 gradient(const openvdb::Vec3d& at) const {
    Vec3 g;
    for (int a = 0; a < 3; ++a) {
      openvdb::Vec3d step(0);
      step[a] = 0.9;
      g[a] = openvdb::tools::BoxSampler::sample(values_, at + step) -
             openvdb::tools::BoxSampler::sample(values_, at - step);
    }
    const double length = g.norm();
    return length > 0 ? Vec3(g / length) : Vec3(Vec3::UnitZ());
  }

  const Scene& scene_;
  const openvdb::FloatGrid& ground_;
  float voxel_;
  Intersector intersector_;
  openvdb::FloatGrid::ConstAccessor values_;
};

/// Directions over the hemisphere about z, weighted by Lambert's law.
std::array<Vec3, kSkyRays> sky_directions() {
  std::array<Vec3, kSkyRays> directions;
  for (int i = 0; i < kSkyRays; ++i) {
    int reversed = 0;  // van der Corput
    for (int bit = 0; bit < 6; ++bit) reversed |= (i >> bit & 1) << (5 - bit);
    const double r2 = (i + 0.5) / kSkyRays;
    const double angle = 2 * std::numbers::pi * (reversed + 0.5) / kSkyRays;
    directions[static_cast<std::size_t>(i)] = {std::sqrt(r2) * std::cos(angle),
                                               std::sqrt(r2) * std::sin(angle), std::sqrt(1 - r2)};
  }
  return directions;
}

/// Sums over the rays of one pixel.
struct Pixel {
  Vec3f sunlit = Vec3f::Zero();  ///< light without smoothing
  Vec3f albedo = Vec3f::Zero();  ///< factor of the sky light
  Vec3f normal = Vec3f::Zero();
  float sky = 0;  ///< over the rays that hit: sum of open sky in [0, 1]
  float hits = 0;
  float distance = 0;  ///< sum
  float shadow = 0;    ///< background: darkening beside the block
};

float contact_shadow(const Scene& scene, const Vec3& eye, const Vec3& direction) {
  if (direction.z() >= 0) return 0;
  const Vec3 p = eye + direction * ((scene.low.z() - eye.z()) / direction.z());
  const Vec2 outside = (scene.low - p).head<2>().cwiseMax((p - scene.high).head<2>()).cwiseMax(0.0);
  const double size = (scene.high - scene.low).head<2>().norm();
  return static_cast<float>(0.34 * std::exp(-outside.norm() / (0.022 * size)) +
                            0.10 * std::exp(-outside.norm() / (0.09 * size)));
}

void trace_pixel(const Scene& scene, const Camera& camera, const Caster& caster,
                 const std::array<Vec3, kSkyRays>& sky, int x, int y, Pixel& out) {
  constexpr std::array<std::array<double, 2>, 4> kSpots{
      {{0.375, 0.125}, {0.875, 0.375}, {0.125, 0.625}, {0.625, 0.875}}};
  for (int s = 0; s < 4; ++s) {
    const auto& spot = kSpots[static_cast<std::size_t>(s)];
    const Vec3 direction = camera.ray(x + spot[0], y + spot[1]);
    Vec3 point, normal;
    if (!caster.hit(camera.eye, direction, point, normal)) {
      out.shadow += contact_shadow(scene, camera.eye, direction);
      continue;
    }
    if (normal.dot(direction) > 0) normal -= 1.001 * normal.dot(direction) * direction;
    normal.normalize();
    const Vec3f albedo = linear(scene.color(point, normal));
    const double facing = normal.dot(scene.to_sun);
    if (facing > 0 && !caster.shaded(point, normal, scene.to_sun)) {
      out.sunlit += static_cast<float>(facing) * albedo.cwiseProduct(plain(kSunLight));
    }
    // 37 is coprime to 64, so neighbouring pixels look at distant parts of the sky.
    const int n = (((y % kTile) * kTile + x % kTile) * 4 + s) * 37 % kSkyRays;
    const Vec3 local = sky[static_cast<std::size_t>(n)];
    const Vec3 side =
        (std::abs(normal.x()) > 0.9 ? Vec3::UnitY() : Vec3::UnitX()).cross(normal).normalized();
    const Vec3 up = local.x() * side + local.y() * normal.cross(side) + local.z() * normal;
    if (!caster.shaded(point, normal, up)) {
      out.sky += static_cast<float>(up.z() > 0 ? 0.75 + 0.25 * up.z() : 0.45);
    } else {
      out.sky += 0.16f;  // light that the ground there reflects
    }
    out.albedo += albedo;
    out.normal += normal.cast<float>();
    out.distance += static_cast<float>((point - camera.eye).norm());
    out.hits += 1;
  }
  out.normal.normalize();
}

/// Sky light, averaged over the pixels that together cover all directions and show the same face of
/// the ground.
float smooth_sky(const std::vector<Pixel>& pixels, int w, int h, int x, int y, float voxel) {
  const auto at = [&](int i, int j) -> const Pixel& {
    return pixels[static_cast<std::size_t>(j) * static_cast<std::size_t>(w) +
                  static_cast<std::size_t>(i)];
  };
  const Pixel& mine = at(x, y);
  const Vec3f& normal = mine.normal;
  const float distance = mine.distance / mine.hits;
  float sum = 0, weight = 0;
  for (int j = std::max(0, y - 4); j <= std::min(h - 1, y + 4); ++j) {
    for (int i = std::max(0, x - 4); i <= std::min(w - 1, x + 4); ++i) {
      const Pixel& p = at(i, j);
      if (p.hits == 0) continue;
      const float apart = std::abs(p.distance / p.hits - distance);
      const float alike = p.normal.dot(normal);
      if (alike < 0.8f || apart > std::max(2 * voxel, 0.004f * distance)) continue;
      // Half weight at the ends gives each of the 4-periodic directions the same weight.
      const float ends = (std::abs(i - x) == 4 ? 0.5f : 1) * (std::abs(j - y) == 4 ? 0.5f : 1);
      sum += ends * p.sky;
      weight += ends * p.hits;
    }
  }
  return weight > 0 ? sum / weight : mine.sky / mine.hits;
}

}  // namespace

double seen(const Scene& scene, const Camera& camera, int w, int h,
            const std::function<double(const Vec3& point)>& wanted) {
  std::vector<double> rows(static_cast<std::size_t>(h));
  tbb::parallel_for(tbb::blocked_range<int>(0, h, 4), [&](const tbb::blocked_range<int>& range) {
    const Caster caster(scene);
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < w; ++x) {
        Vec3 point, normal;
        if (!caster.hit(camera.eye, camera.ray(x + 0.5, y + 0.5), point, normal)) continue;
        rows[static_cast<std::size_t>(y)] += std::max(0.0, wanted(point));
      }
    }
  });
  return std::accumulate(rows.begin(), rows.end(), 0.0) / (w * h);
}

std::vector<std::uint32_t> render(const Scene& scene, const Camera& camera, int w, int h) {
  const std::array<Vec3, kSkyRays> sky = sky_directions();
  std::vector<Pixel> pixels(static_cast<std::size_t>(w) * static_cast<std::size_t>(h));
  tbb::parallel_for(tbb::blocked_range<int>(0, h, 8), [&](const tbb::blocked_range<int>& range) {
    const Caster caster(scene);
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < w; ++x) {
        trace_pixel(scene, camera, caster, sky, x, y,
                    pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) +
                           static_cast<std::size_t>(x)]);
      }
    }
  });
  const auto voxel = static_cast<float>(scene.ground->voxelSize().x());
  const Vec3f sky_light = plain(kSkyLight);
  std::vector<std::uint32_t> out(pixels.size());
  tbb::parallel_for(tbb::blocked_range<int>(0, h, 8), [&](const tbb::blocked_range<int>& range) {
    for (int y = range.begin(); y < range.end(); ++y) {
      for (int x = 0; x < w; ++x) {
        const std::size_t at =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x);
        const Pixel& p = pixels[at];
        const Rgb behind = mix(kBackgroundTop, kBackgroundFoot, static_cast<double>(y) / h);
        const float open = 1 - p.hits / 4;
        const float dark = open > 0 ? 1 - p.shadow / (4 * open) : 1;
        Vec3f light = open * dark * linear(behind);
        if (p.hits > 0) {
          const float ambient = smooth_sky(pixels, w, h, x, y, voxel);
          light += 0.25f * (p.sunlit + ambient * p.albedo.cwiseProduct(sky_light));
        }
        const auto srgb = [](float v) { return std::pow(std::max(v, 0.0f), 1 / 2.2f); };
        out[at] = to_pixel({srgb(light.x()), srgb(light.y()), srgb(light.z())});
      }
    }
  });
  return out;
}

}  // namespace soilvdb::inline v0::io
