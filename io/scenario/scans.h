// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Sections `sensors` and `scans` of a scenario.
#pragma once

#include "io/scenario/yaml_map.h"
#include "soilvdb/io/scenario.h"

namespace soilvdb::inline v0::io {

/// Reads both, and each scan's file to its end. To be called after the machines were read.
void read_scan_inputs(const YamlMap& scenario, Scenario& result);

}  // namespace soilvdb::inline v0::io
