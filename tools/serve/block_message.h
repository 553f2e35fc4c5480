// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A block of the ground's surface as bytes for viewers; tools/guide/live.md defines the format.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "soilvdb/boundary_volume.h"
#include "soilvdb/ground.h"
#include "soilvdb/mesher.h"

namespace soilvdb::tools {

/// @param mesh of the block
/// @param view number of the view
/// @param before heights that changes refer to
/// @param design empty: no design
/// @param soil_moves may soil be loose?
/// @param ground_before the ground of `before`, if it has the same lattice; soil that is equal in
///        both has no change, however steep it is
std::string block_message(const Ground& ground, const Coord3& block, const Mesh& mesh,
                          std::uint32_t view, const Heights& before, const Heights& design,
                          bool soil_moves, const Ground* ground_before = nullptr);

/// A zlib stream of these bytes.
std::string deflated(std::string_view bytes);

}  // namespace soilvdb::tools
