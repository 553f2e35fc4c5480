// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/change_plan.h"

#include "core/surface.h"
#include "io/ground_source.h"

namespace soilvdb::io {

void write_change_plan(const std::filesystem::path& file, const Soil& before, const Soil& after,
                       const Eigen::AlignedBox2d& changed, const Caption& caption) {
  const Ground ground{
      .now = [&after](double x, double y) { return surface_height(after, x, y); },
      .base = [&before](double x, double y) { return surface_height(before, x, y); },
      .voxel_size_m = after.voxel_size_m(),
      .cut = changed};
  const Vec2 margin = Vec2::Constant(0.15 * changed.sizes().maxCoeff());
  const Eigen::AlignedBox2d box(changed.min() - margin, changed.max() + margin);
  Canvas canvas = draw_plan(ground, box, caption);
  save(file, canvas);
}

}  // namespace soilvdb::io
