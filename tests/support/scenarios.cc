// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tests/support/scenarios.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <numbers>
#include <stdexcept>
#include <utility>

#include "tests/support/families.h"
#include "tests/support/oracle.h"

namespace soilvdb::test {
namespace {

class InMemory final : public HeightSource {
 public:
  InMemory(Posts posts, double shift_m) : posts_(std::move(posts)) {
    for (float& z : posts_.heights_m) z = static_cast<float>(z + shift_m);
  }
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int y = y0; y < y0 + ny; ++y) {
      const auto row = posts_.heights_m.begin() + y * posts_.side + x0;
      out = std::copy(row, row + nx, out);
    }
  }

 private:
  Posts posts_;
};

/// Bilinear between posts about (0, 0).
double bilinear(const Posts& posts, const Vec2& p) {
  const double half = (posts.side - 1) * posts.spacing_m / 2;
  const Vec2 u = (p.array() + half).matrix() / posts.spacing_m;
  const int i = static_cast<int>(std::floor(u.x())), j = static_cast<int>(std::floor(u.y()));
  if (i < 0 || j < 0 || i + 1 >= posts.side || j + 1 >= posts.side) {
    throw std::logic_error("the dig leaves its raster");
  }
  const auto at = [&](int x, int y) {
    return double{posts.heights_m[static_cast<std::size_t>(y * posts.side + x)]};
  };
  const double s = u.x() - i, t = u.y() - j;
  return (1 - t) * ((1 - s) * at(i, j) + s * at(i + 1, j)) +
         t * ((1 - s) * at(i, j + 1) + s * at(i + 1, j + 1));
}

/// The ground in the family's frame. A raster stays aligned with the world, so it turns the other
/// way.
Terrain terrain(const Family& f, double yaw_rad) {
  if (!f.posts) {
    return {[&f](const Vec2& p) { return f.height_m + f.slope.dot(p); }, true};
  }
  const Eigen::Rotation2Dd turn(yaw_rad);
  return {[&f, turn](const Vec2& p) { return bilinear(*f.posts, turn * p); }, false};
}

Volume truth(const Family& f, double yaw_rad) {
  if (f.closed_form_m3) return {*f.closed_form_m3, 1e-12 * *f.closed_form_m3};
  const Terrain ground = terrain(f, yaw_rad);
  const Sweep sweep = f.sweep();
  if (!f.planar) return spatial_volume(sweep, ground, f.direction);
  const bool uniform = !f.posts && f.slope.y() == 0;
  return uniform ? planar_volume(sweep, ground, f.direction, 6000, 1)
                 : planar_volume(sweep, ground, f.direction, 600, 48);
}

/// Remembered: a dig is placed many times. Only a raster's truth depends on the placement.
Volume remembered_truth(const Family& f, double yaw_rad) {
  static std::mutex mutex;
  static std::map<std::pair<std::string, double>, Volume> known;
  const std::lock_guard lock(mutex);
  const auto [it, fresh] = known.try_emplace({f.name, f.posts ? yaw_rad : 0.0});
  if (fresh) it->second = truth(f, yaw_rad);
  return it->second;
}

std::shared_ptr<const InitialTerrain> terrain(const Family& f, const Placement& placement) {
  const Vec3& o = placement.offset;
  if (f.posts) {
    const double first = -(f.posts->side - 1) * f.posts->spacing_m / 2;
    HeightGrid grid;
    grid.nx = grid.ny = f.posts->side;
    grid.first = o.head<2>() + Vec2::Constant(first);
    grid.spacing = Vec2::Constant(f.posts->spacing_m);
    return make_height_field(grid, std::make_shared<InMemory>(*f.posts, o.z()));
  }
  const Vec2 slope = Eigen::Rotation2Dd(placement.yaw_rad) * f.slope;
  return make_plane(o.z() + f.height_m - slope.dot(o.head<2>()), slope);
}

Dig place(const Family& f, const Placement& placement) {
  const Pose world_from_family{placement.offset, from_rpy(0, 0, placement.yaw_rad)};
  const Volume exact = remembered_truth(f, placement.yaw_rad);
  return {f.name,
          placement,
          f.bucket,
          f.motion(world_from_family),
          terrain(f, placement),
          placement.offset.array().floor().matrix(),
          exact.m3,
          exact.uncertainty_m3};
}

}  // namespace

const std::vector<std::string>& families() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const Family& f : all_families()) all.push_back(f.name);
    return all;
  }();
  return names;
}

Dig make_dig(const std::string& family, const Placement& placement) {
  for (const Family& f : all_families()) {
    if (f.name == family) return place(f, placement);
  }
  throw std::invalid_argument("there is no family of digs named " + family);
}

std::vector<Placement> placements() {
  constexpr double kDegree = std::numbers::pi / 180;
  // Shifts in z are binary fractions: heights of a raster are float.
  return {{0, Vec3::Zero()},
          {33 * kDegree, {12.3417, -7.6131, 1.015625}},
          {45 * kDegree, {-3.1177, 5.2263, -0.328125}},
          {71.3 * kDegree, {0.5031, 0.7774, 0.265625}}};
}

Dig random_dig(std::uint64_t seed) {
  const double turn = static_cast<double>(seed * 37 % 360) * std::numbers::pi / 180;
  const double s = static_cast<double>(seed % 101);
  return place(random_family(seed), {turn, {0.137 * s, -0.291 * s, 0.0173 * s}});
}

}  // namespace soilvdb::test
