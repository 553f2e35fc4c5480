// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The parts of `bench speed`; each writes a CSV file and adds its figures.
#pragma once

#include "bench/report.h"

namespace soilvdb::bench {

/// Time per update against the side of the site, ours and stock OpenVDB's: site.csv.
void measure_site_sizes(const Options& options, Goals& goals);
/// Against voxel size, bucket size and threads: sizes.csv; two threads over one on large strokes.
void measure_voxel_sizes(const Options& options, Goals& goals);
/// Ratios to the peers: peers.csv.
void measure_peers(const Options& options, Goals& goals);
/// Ten machines for a shift, one and two threads: replay.csv.
void measure_replay(const Options& options, Goals& goals);
/// Memory per m2, and what is accounted against what is taken. Call it before there are threads.
void measure_memory(const Options& options, Goals& goals);
/// Updates at 100 Hz with meshing and snapshots; what those cost by what changed: latency.csv,
/// service.csv.
void measure_latency(const Options& options, Goals& goals);

}  // namespace soilvdb::bench
