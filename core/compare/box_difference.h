// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The difference of two grounds whose voxels are not the same.
#pragma once

#include "soilvdb/difference.h"

namespace soilvdb::inline v0 {

/// As difference() has it for grounds that are not of one lattice and base.
Difference box_difference(const Ground& before, const Ground& after);

}  // namespace soilvdb::inline v0
