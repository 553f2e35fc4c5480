// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where the buckets and pours of a scenario go, checked against a site before anything is dug.
#pragma once

#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"

namespace soilvdb::inline v0::io {

/// Refuses what a run would fail on, or what is surely a slip. Motions are read again only where
/// they come near ground without a height or would dig a great deal.
/// @throw InputError naming the scenario and what would be right: no bucket ever comes over the
///        terrain; one digs where the terrain has no height; the motion is too far from the site's
///        origin for the voxel size; it digs on for more than 1 km from one row to the next; the
///        ground it digs would need more than half of the memory, or
///        an output raster of more cells than can be written; what check_pours() refuses.
void check_workspace(const Scenario& scenario, const Site& site);

}  // namespace soilvdb::inline v0::io
