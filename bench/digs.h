// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs an engine over one of the shared digs: what accuracy and speed are both measured by.
#pragma once

#include "bench/engine.h"
#include "tests/support/scenarios.h"

namespace soilvdb::bench {

struct Run {
  double error = 0;  ///< (cut - exact) / exact
  double us_per_update = 0;
  double setup_s = 0;
  int updates = 0;
  int failures = 0;
  bool complete = false;  ///< false: given up at the time cap
};

Task task_of(const test::Dig& dig, double voxel_m);

/// @param cap_s time after which the run is given up
/// @throw EngineFailed and whatever the engine throws
Run run(const MakeEngine& make, const test::Dig& dig, double voxel_m, int updates, double cap_s);

/// Does the engine get a dig right that asks nothing of it but to be correct? A drag in twenty
/// thick strokes at 2.5 cm voxels, off the grid. @return the error
double check(const Peer& peer);

/// Error above which check() means that an engine is broken, not coarse: that of a cut whose floor,
/// ends and sides all lie half a voxel off, 1.47 m2 x 1.25 cm around 0.128 m3.
inline constexpr double kBroken = 0.15;

}  // namespace soilvdb::bench
