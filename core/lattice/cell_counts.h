// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Number of samples in each cell of a chunk.
#pragma once

#include <array>
#include <cstdint>

#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {

using CellCounts = std::array<std::uint8_t, kChunkVoxels>;

void count_cells(const SampleWords& words, CellCounts& counts);

}  // namespace soilvdb::inline v0
