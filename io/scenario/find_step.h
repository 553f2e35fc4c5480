// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where a bucket goes, looked at ever closer: blocks of its way, steps, poses.
#pragma once

#include <functional>
#include <vector>

#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "soilvdb/io/swept_boxes.h"

namespace soilvdb::inline v0::io {

/// Is the ground in a box known? Says no of boxes so long that all heights would be read.
bool surely_known(const Site& site, const Box3& box);
/// Is a box free of soil? Says no of boxes so long that all heights would be read.
bool surely_air(const Site& site, const Box3& box);

/// Shows the steps in those blocks of a machine's way that are wanted, until one is what was looked
/// for. Only the parts of the motion that hold one are read. @return whether it was found
bool find_step(const MachineInput& machine, const std::function<bool(const Box3&)>& wanted,
               const std::function<bool(const Motion& part, const StepBox&)>& found);

Box3 box_at(const Pose& world_from_bucket, const Corners& corners);

/// Boxes about the bucket from pose to pose of a step's path, closer than a voxel of `h` metres to
/// each other.
std::vector<Box3> close_boxes(const MachineInput& m, const Motion& part, std::size_t row, double h);

}  // namespace soilvdb::inline v0::io
