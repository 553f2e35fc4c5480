// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Warns of motions that stay underground, because motion and terrain have different height datums.
#pragma once

#include "soilvdb/initial_terrain.h"
#include "soilvdb/io/scenario.h"

namespace soilvdb::inline v0::io {

/// Adds a warning for each machine whose whole bucket is below the ground at all rows. Reads a
/// motion up to the first other row.
void warn_of_underground(Scenario& scenario, const InitialTerrain& terrain);

}  // namespace soilvdb::inline v0::io
