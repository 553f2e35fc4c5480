// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Checks the pours of a scenario against a site.
#pragma once

#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"

namespace soilvdb::inline v0::io {

/// @throw InputError naming the scenario and what would be right, if a pour begins underground,
///        where the terrain has no height, or too far away for the voxel size.
void check_pours(const Scenario& scenario, const Site& site);

}  // namespace soilvdb::inline v0::io
