// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/picture.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <utility>

#include "io/draw/ground_source.h"
#include "io/draw/loose_soil.h"
#include "io/file/atomic_file.h"
#include "soilvdb/surface_height.h"
#include "soilvdb/volume_changes.h"

namespace soilvdb::inline v0::io {

Eigen::AlignedBox2d footprint(const Ground& ground, bool changed_only) {
  Eigen::AlignedBox2d box;
  for (const Ground* s = &ground; s != nullptr; s = s->terrain().ground())
    for (const Chunk* chunk : s->chunks()) {
      if (changed_only && chunk->soil_count >= chunk->base_count && chunk->loose_count == 0)
        continue;
      // Cells reach half a voxel beyond the centres.
      const Vec3 low = s->world_from_index(chunk->origin.cast<double>() - Vec3::Constant(0.5));
      box.extend(low.head<2>());
      box.extend(low.head<2>() + Vec2::Constant(s->voxel_size_m() * kChunkSide));
    }
  return box;
}

CutAndFill cut_and_fill(const Ground& ground) {
  const VolumeBins bins = VolumeBins::columns(ground.origin().head<2>(), ground.voxel_size_m());
  std::map<std::pair<int, int>, double> columns_m3;
  for (const Ground* s = &ground; s != nullptr; s = s->terrain().ground()) {
    for_each_volume_change(*s, bins, [&](const VolumeBins::Box& box, const VolumeChange& gain) {
      columns_m3[{box[0], box[1]}] += gain.m3;
    });
  }
  CutAndFill sum;
  for (const auto& [column, gain_m3] : columns_m3) {
    (gain_m3 < 0 ? sum.cut_m3 : sum.fill_m3) += std::abs(gain_m3);
  }
  return sum;
}

Eigen::AlignedBox2d region_of_interest(const Ground& ground) {
  Eigen::AlignedBox2d box = footprint(ground, true);
  if (box.isEmpty()) box = footprint(ground, false);
  if (box.isEmpty()) {
    const Vec2 centre = ground.origin().head<2>();
    return {centre - Vec2::Constant(10), centre + Vec2::Constant(10)};
  }
  const double size_m = box.sizes().maxCoeff();
  const Vec2 margin = Vec2::Constant(0.15 * size_m + std::min(1.0, 0.3 * size_m));
  return {box.min() - margin, box.max() + margin};
}

std::function<double(const Vec3&)> loose_of(const Ground& ground) {
  if (!has_loose(ground)) return {};
  return [&ground](const Vec3& point) { return looseness(ground, point); };
}

DrawnGround ground_of(const Ground& ground) {
  bool filled = false;
  for (const Ground* s = &ground; s != nullptr; s = s->terrain().ground())
    filled |= !s->above_base().isEmpty();
  return {.now = surface_heights(ground),
          .base = [&ground](double x, double y) { return ground.initial_terrain().height(x, y); },
          .voxel_size_m = ground.voxel_size_m(),
          .changed = footprint(ground, true),
          .filled = filled,
          .loose = loose_of(ground)};
}

Relief relief_of(const DrawnGround& ground, const Eigen::AlignedBox2d& box, int nx, int ny) {
  return sample_relief(ground.now, ground.base, box, nx, ny, ground.least_m(), ground.filled);
}

ChangeScale change_scale(const DrawnGround& ground, const Eigen::AlignedBox2d& box) {
  const Eigen::AlignedBox2d part = box.intersection(ground.changed);
  if (ground.changed.isEmpty() || part.isEmpty() || !(part.sizes().minCoeff() > 0)) return {};
  const double cell = std::max(ground.voxel_size_m / 3, part.sizes().maxCoeff() / 700);
  const auto cells = [&](double length) {
    return std::max(1, static_cast<int>(std::ceil(length / cell)));
  };
  const Relief relief = relief_of(ground, part, cells(part.sizes().x()), cells(part.sizes().y()));
  return ChangeScale::up_to(deepest(relief), highest(relief), ground.least_m());
}

Eigen::AlignedBox2d drawable(const Eigen::AlignedBox2d& box, double voxel_size_m) {
  if (box.isEmpty() || !box.min().allFinite() || !box.max().allFinite()) {
    throw std::invalid_argument(
        "a picture needs a region with finite sides, xmin < xmax and ymin < ymax");
  }
  const double least = std::max(
      {4 * voxel_size_m, box.sizes().maxCoeff() / 12, 1e-9 * box.max().cwiseAbs().maxCoeff()});
  const Vec2 half = box.sizes().cwiseMax(least) / 2;
  return {box.center() - half, box.center() + half};
}

void save(const std::filesystem::path& file, Canvas& canvas) {
  write_atomically(file, canvas.png());
}

}  // namespace soilvdb::inline v0::io
