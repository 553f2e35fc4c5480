// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Buckets that never see the light: heights of motion and terrain from different zeros.
#pragma once

#include "soilvdb/initial_terrain.h"
#include "soilvdb/io/scenario.h"

namespace soilvdb::inline v0::io {

/// Adds a warning to the scenario's for each machine whose whole bucket is below the ground at all
/// rows of its motion. Reads a motion up to the first row that isn't.
void warn_of_underground(Scenario& scenario, const InitialTerrain& terrain);

}  // namespace soilvdb::inline v0::io
