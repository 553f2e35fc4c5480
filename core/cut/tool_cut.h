// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The cut of a tool of any shape along a traced path.
#pragma once

#include <span>

#include "soilvdb/tool_shape.h"

namespace soilvdb::inline v0 {

/// @throw NoGroundError where the terrain has no height at a pose
void require_ground(const Ground& ground, const ToolShape& tool, std::span<const Pose> path);

/// As subtract(). @param path ends of segments with their middles between, as from trace(), or one
/// pose; the terrain must have heights everywhere on it
ToolCut subtract_traced(Ground& ground, const ToolShape& tool, std::span<const Pose> path);

}  // namespace soilvdb::inline v0
