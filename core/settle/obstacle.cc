// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/obstacle.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "soilvdb/tool_shape.h"

namespace soilvdb::inline v0 {
namespace {

/// Calls `add` with points inside a tool, each less than a cell from the next, in index space.
template <typename F>
void add_shape(const ToolShape& shape, const Pose& world_from_tool, const Ground& ground,
               const F& add) {
  const Eigen::AlignedBox3d& box = shape.box_m();
  const double step = kObstacleStep * ground.voxel_size_m();
  const Coord3 n = (box.sizes() / step).array().ceil().max(1).matrix().cast<int>();
  for (int x = 0; x <= n.x(); ++x)
    for (int y = 0; y <= n.y(); ++y)
      for (int z = 0; z <= n.z(); ++z) {
        const Vec3 p =
            box.min() + box.sizes().cwiseProduct(Vec3(x, y, z).cwiseQuotient(n.cast<double>()));
        // A thin blade may lie between two points: it is met by what is as near.
        if (shape.distance_m(p) < step / 2) add(ground.index_from_world(world_from_tool * p));
      }
}

}  // namespace

Obstacle::Obstacle(const Bucket& bucket, const Pose& world_from_bucket, const Ground& ground) {
  Eigen::AlignedBox3d box;
  for (const Vec3& p : extremes(bucket)) box.extend(ground.index_from_world(world_from_bucket * p));
  const auto cell = [](double at) { return static_cast<int>(std::floor(at + 0.5)); };
  first_ = {cell(box.min().x()), cell(box.min().y())};
  nx_ = cell(box.max().x()) - first_.x() + 1;
  ny_ = cell(box.max().y()) - first_.y() + 1;
  lowest_.assign(static_cast<std::size_t>(nx_ * ny_), std::numeric_limits<float>::infinity());
  const auto add = [&](const Vec3& p) {
    const int x = std::clamp(cell(p.x()) - first_.x(), 0, nx_ - 1);
    const int y = std::clamp(cell(p.y()) - first_.y(), 0, ny_ - 1);
    float& lowest = lowest_[static_cast<std::size_t>(x * ny_ + y)];
    lowest = std::min(lowest, static_cast<float>(p.z()));
  };
  if (bucket.shape) {
    add_shape(*bucket.shape, world_from_bucket, ground, add);
    return;
  }
  // Points of the faces across the lip, each less than a cell from the next. The side plates' lower
  // ends are among them.
  std::vector<Vec2> outline = bucket.profile;
  if (outline.empty()) outline = {{0, 0}, {0, bucket.height_m}};
  outline.push_back(outline.front());
  const double step = kObstacleStep * ground.voxel_size_m();
  const auto steps = [&](double length) {
    return std::max(1, static_cast<int>(std::ceil(length / step)));
  };
  const int across = steps(bucket.width_m);
  const Vec3 along_lip = world_from_bucket.rotation * Vec3::UnitY() / ground.voxel_size_m();
  for (std::size_t i = 0; i + 1 < outline.size(); ++i) {
    const Vec2 edge = outline[i + 1] - outline[i];
    const int n = steps(edge.norm());
    for (int k = 0; k <= n; ++k) {
      const Vec2 at = outline[i] + edge * (static_cast<double>(k) / n);
      const Vec3 middle = ground.index_from_world(world_from_bucket * Vec3(at.x(), 0, at.y()));
      for (int j = 0; j <= across; ++j) {
        add(middle + along_lip * (bucket.width_m * (static_cast<double>(j) / across - 0.5)));
      }
    }
  }
}

bool Obstacle::blocks(int x, int y, double top, float clearance) const {
  const int i = x - first_.x(), j = y - first_.y();
  if (i < 0 || j < 0 || i >= nx_ || j >= ny_) return false;
  return lowest_[static_cast<std::size_t>(i * ny_ + j)] < top + clearance;
}

BlockedColumns::BlockedColumns(GroundColumns& ground, std::span<const Obstacle* const> obstacles,
                               float clearance)
    : ground_(&ground), clearance_(clearance) {
  for (const Obstacle* obstacle : obstacles) {
    if (obstacle->empty()) continue;
    masks_.push_back({obstacle, {}});
    over_.extend(obstacle->cells());
  }
}

bool BlockedColumns::blocks(const Coord2& cell) {
  for (Mask& mask : masks_) {
    const Obstacle& obstacle = *mask.obstacle;
    const Coord2 in = cell - obstacle.first_;
    if (in.x() < 0 || in.y() < 0 || in.x() >= obstacle.nx_ || in.y() >= obstacle.ny_) continue;
    if (mask.blocked.empty()) look_at(mask);
    if (mask.blocked[static_cast<std::size_t>(in.x() * obstacle.ny_ + in.y())] != 0) return true;
  }
  return false;
}

void BlockedColumns::look_at(Mask& mask) {
  const Obstacle& obstacle = *mask.obstacle;
  const int nx = obstacle.nx_, ny = obstacle.ny_;
  std::vector<std::uint8_t>& blocked = mask.blocked;
  blocked.assign(static_cast<std::size_t>(nx * ny), 1);
  // From beyond the obstacle soil comes to the columns that it doesn't stand in.
  std::vector<Coord2> open;
  const auto come_to = [&](int i, int j) {
    if (i < 0 || j < 0 || i >= nx || j >= ny) return;
    std::uint8_t& here = blocked[static_cast<std::size_t>(i * ny + j)];
    if (here == 0) return;
    const Coord2 cell = obstacle.first_ + Coord2(i, j);
    if (obstacle.blocks(cell.x(), cell.y(), ground_->column(cell).surface, clearance_)) return;
    here = 0;
    open.emplace_back(i, j);
  };
  for (int i = 0; i < nx; ++i)
    for (const int j : {0, ny - 1}) come_to(i, j);
  for (int j = 0; j < ny; ++j)
    for (const int i : {0, nx - 1}) come_to(i, j);
  while (!open.empty()) {
    const Coord2 at = open.back();
    open.pop_back();
    for (const auto& [i, j] : {std::pair(-1, 0), {1, 0}, {0, -1}, {0, 1}})
      come_to(at.x() + i, at.y() + j);
  }
}

}  // namespace soilvdb::inline v0
