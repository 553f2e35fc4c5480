// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Boxes that cover a mesh.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

/// Boxes that cover triangles and, with room about each, little else: a bent boom is in several, a
/// straight one in one. @return at least one, if there are triangles
std::vector<Eigen::AlignedBox3d> boxes_about(const std::vector<std::array<Vec3, 3>>& triangles,
                                             double room_m);

}  // namespace soilvdb::inline v0::io
