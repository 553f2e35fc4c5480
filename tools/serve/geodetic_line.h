// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The key `geodetic` of a feed's lines: places of a machine's antennas by latitude and longitude.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "io/terrain/geodetic.h"
#include "soilvdb/gnss.h"
#include "soilvdb/types.h"

namespace soilvdb::tools {

/// The pose of the frame in which the antennas are mounted, world: of two antennas, or of one and
/// the rotation that the line has.
/// @param is_fixed the positions are good enough to dig; two antennas must then be as far apart as
///        they are mounted
/// @throw std::invalid_argument with one line
Pose geodetic_pose(const nlohmann::json& json, const Gnss& gnss, const io::Geodetic& geodetic,
                   bool is_fixed);

}  // namespace soilvdb::tools
