// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/lattice/cell_counts.h"

#include <bit>

#include "core/lattice/affine.h"

namespace soilvdb::inline v0 {

SOILVDB_FOR_CPUS void count_cells(const SampleWords& words, CellCounts& counts) {
  for (std::size_t n = 0; n < words.size(); ++n)
    counts[n] = static_cast<std::uint8_t>(std::popcount(words[n]));
}

}  // namespace soilvdb::inline v0
