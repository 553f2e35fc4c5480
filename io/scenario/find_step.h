// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Finds a step of a bucket's way by ever smaller boxes: blocks, steps, poses.
#pragma once

#include <functional>
#include <vector>

#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "soilvdb/io/swept_boxes.h"

namespace soilvdb::inline v0::io {

/// Is the ground in a box known? False for boxes so large that all heights would be read.
bool surely_known(const Site& site, const Box3& box);
/// Is a box free of soil? False for boxes so large that all heights would be read.
bool surely_air(const Site& site, const Box3& box);

/// Calls `found` for the steps in wanted blocks of a machine's way, until it returns true. Reads
/// only the parts of the motion with such blocks. @return was a step found?
bool find_step(const MachineInput& machine, const std::function<bool(const Box3&)>& wanted,
               const std::function<bool(const Motion& part, const StepBox&)>& found);

Box3 box_at(const Pose& world_from_bucket, const Corners& corners);

/// Boxes around the bucket along a step's path, from pose to pose less than a voxel (`h` m) apart.
std::vector<Box3> close_boxes(const MachineInput& m, const Motion& part, std::size_t row, double h);

}  // namespace soilvdb::inline v0::io
