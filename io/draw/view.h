// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The lit view of a block of ground, from any ground that can be made a closed level set.
#pragma once

#include <functional>

#include "io/draw/ground_source.h"
#include "io/draw/ray_tracer.h"

namespace soilvdb::inline v0::io {

/// The ground in a box of the world as a closed level set relative to the origin. Null if that is
/// impossible; the view then uses heights.
using MakeBlock = std::function<openvdb::FloatGrid::ConstPtr(const Eigen::AlignedBox3d& box)>;

/// The picture write_view() writes.
Canvas draw_view(const DrawnGround& ground, const MakeBlock& make_block, const Vec3& origin,
                 const Eigen::AlignedBox2d& box, const Caption& caption);

}  // namespace soilvdb::inline v0::io
