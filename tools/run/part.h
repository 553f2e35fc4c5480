// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How a run begins, and how far a part of a scenario reaches, which is dug apart from the rest.
#pragma once

#include "soilvdb/io/scenario.h"
#include "soilvdb/io/swept_boxes.h"
#include "tools/run/run.h"
#include "tools/run/run_options.h"
#include "tools/run/schedule.h"

namespace soilvdb::tools {

/// A box of the world beyond which a step changes nothing, and nothing changes what it does. As
/// Tracker has it of machines that may move at once.
io::Box3 reach_of(const Step& step, const Bucket& bucket, double voxel_size_m);

/// The ground that a run begins with: the scenario's, or of a part what was dug before, without
/// what is out of its machines' reach.
/// @throw io::InputError as io::open_site() and io::read_snapshot()
Start begin_of(const RunOptions& options, const io::Scenario& scenario);

}  // namespace soilvdb::tools
