// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The difference of two soils whose voxels are not the same.
#pragma once

#include "soilvdb/difference.h"

namespace soilvdb::inline v0 {

/// As difference() has it for soils that are not of one lattice and base.
Difference box_difference(const Soil& before, const Soil& after);

}  // namespace soilvdb::inline v0
