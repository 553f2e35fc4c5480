// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The sample points of a cell, once more in the order in which planes are asked of them.
#pragma once

#include "soilvdb/base_surface.h"

namespace soilvdb::inline v0 {

struct CellSamples {
  CellPoints points;
  /// Point 8 j + k at 8 k + j, so that eight lanes that look at one after another of their points
  /// make a byte each of the word.
  CellPoints columns;
};

/// By pattern, kPatterns of them.
const CellSamples* cell_samples();

}  // namespace soilvdb::inline v0
