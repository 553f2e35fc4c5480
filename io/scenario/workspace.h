// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Checks the ways of a scenario's buckets and pours against a site before digging.
#pragma once

#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"

namespace soilvdb::inline v0::io {

/// Refuses scenarios that would fail, or that are certainly wrong. Reads motions again only where
/// they come near ground without a height or would dig a lot.
/// @throw InputError naming the scenario and what would be right, if no bucket comes over the
///        terrain; if a bucket digs where the terrain has no height, or more than 1 km from one row
///        to the next; if a motion is too far from the site's origin for the voxel size; if the dug
///        ground needs more than half of the memory; if an output raster has too many cells; or if
///        check_pours() refuses.
void check_workspace(const Scenario& scenario, const Site& site);

}  // namespace soilvdb::inline v0::io
