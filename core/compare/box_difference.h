// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The difference of two grounds with different voxels.
#pragma once

#include "soilvdb/difference.h"

namespace soilvdb::inline v0 {

/// difference() of grounds without a common lattice and initial terrain.
Difference box_difference(const Ground& before, const Ground& after);

}  // namespace soilvdb::inline v0
