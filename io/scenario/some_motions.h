// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A scenario of which only some machines are to move: reading the motions of all may take longer
// than to dig those.
#pragma once

#include <string>
#include <vector>

#include "soilvdb/io/scenario.h"

namespace soilvdb::inline v0::io {

/// read_scenario() without the motions of machines that aren't named.
Scenario read_scenario_of(const std::vector<std::string>& names, const std::filesystem::path& file,
                          const ReadProgress& progress);

}  // namespace soilvdb::inline v0::io
