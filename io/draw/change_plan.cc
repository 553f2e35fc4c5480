// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/draw/change_plan.h"

#include "io/draw/ground_source.h"
#include "soilvdb/surface_height.h"

namespace soilvdb::inline v0::io {

void write_change_plan(const std::filesystem::path& file, const Ground& before, const Ground& after,
                       const Eigen::AlignedBox2d& changed, bool filled, const Caption& caption) {
  const DrawnGround ground{.now = surface_heights(after),
                           .base = surface_heights(before),
                           .voxel_size_m = after.voxel_size_m(),
                           .changed = changed,
                           .filled = filled,
                           .loose = loose_of(after)};
  const Vec2 margin = Vec2::Constant(0.15 * changed.sizes().maxCoeff());
  const Eigen::AlignedBox2d box(changed.min() - margin, changed.max() + margin);
  Canvas canvas = draw_plan(ground, box, caption);
  save(file, canvas);
}

}  // namespace soilvdb::inline v0::io
