// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What whoever watches a live site must know now.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "soilvdb/initial_terrain.h"
#include "tools/serve/live_site.h"

namespace soilvdb::tools {

/// Corners of a boundary, one "x,y" in a line of a file, without the first again.
/// @throw io::InputError
std::vector<Vec2> read_boundary(const std::filesystem::path& file);

/// The alarms as objects with `kind`, `machine` or null, and `text`.
/// @param design null: none
/// @param boundary that machines must not leave; empty: none
/// @param folder of the recording; empty: none
nlohmann::ordered_json alarms(const LiveSite& site, const InitialTerrain* design,
                              const std::vector<Vec2>& boundary,
                              const std::filesystem::path& folder);

}  // namespace soilvdb::tools
