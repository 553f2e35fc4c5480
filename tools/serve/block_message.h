// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A block of the ground's surface as bytes for viewers; tools/guide/live.md says how they read.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "soilvdb/ground.h"
#include "soilvdb/mesher.h"

namespace soilvdb::tools {

/// Heights at places of the world, m; NaN where there are none.
using Heights = std::function<void(std::span<const Vec2> xy_m, std::span<double> heights_m)>;

/// @param mesh of the block
/// @param view that it belongs to
/// @param before the ground that changes are against
/// @param design empty: there is none
/// @param soil_moves may there be loose soil?
/// @param ground_before whose heights `before` gives, where that is soil of the same lattice: what
///        is as it was there hasn't changed, however steep it is
std::string block_message(const Ground& ground, const Coord3& block, const Mesh& mesh,
                          std::uint32_t view, const Heights& before, const Heights& design,
                          bool soil_moves, const Ground* ground_before = nullptr);

/// A zlib stream of these bytes.
std::string deflated(std::string_view bytes);

}  // namespace soilvdb::tools
