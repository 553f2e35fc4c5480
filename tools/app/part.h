// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb part: what programs call that dig a scenario on several machines.
#pragma once

namespace soilvdb::tools {

/// part plan SCENARIO --out DIR --parts N [--voxel M] [--updates N] [--memory MB]: into DIR, how
/// the scenario is dug in parts, at most N at once. part dig DIR --window W --part P [--threads N]:
/// one of them, from where it was left. part merge DIR --window W: what the parts of a window left.
/// Of the last window it makes DIR a run that `soilvdb resume` finishes. No help tells of them. A
/// signal ends them as a crash would: they go on when called again.
/// @return 0; what goes wrong is thrown, as by other commands
int part_main(int argc, char** argv);

}  // namespace soilvdb::tools
