// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a tool of any shape takes out of the ground along a path that was traced.
#pragma once

#include <span>

#include "soilvdb/tool_shape.h"

namespace soilvdb::inline v0 {

/// @throw NoGroundError where the terrain has no height at a pose
void require_ground(const Ground& ground, const ToolShape& tool, std::span<const Pose> path);

/// As subtract(). @param path ends of segments and, between them, their middles, as from trace();
/// or one pose. There is ground everywhere
ToolCut subtract_traced(Ground& ground, const ToolShape& tool, std::span<const Pose> path);

}  // namespace soilvdb::inline v0
