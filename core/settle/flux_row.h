// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What flows out of a row of columns, and what is left in it: the loops that take the time.
#pragma once

#include <cstddef>

namespace soilvdb::inline v0 {

/// A row of a FluxGrid, each array from the row's first column.
struct FluxRow {
  int columns;  ///< a multiple of 8
  std::ptrdiff_t stride;
  float limit, swell;
  const float *base, *bank, *soil, *brink[4];
  float *top, *depth;
  float *flux[8], *ahead[8], *out[4];
};

/// A step of all fluxes of a row. @return by how much its momentum led uphill
double push(const FluxRow& row, float momentum);
/// Soil, and so heights, after what flowed.
void settle(const FluxRow& row);

/// How far from rest columns are, in sides of the finest of them.
struct Unrest {
  float steep = 0;   ///< drop beyond the limit, of soil that is free to go
  float flux = 0;    ///< drop by which a flux isn't what it should be
  float hollow = 0;  ///< soil that a column gave without having it
};
Unrest unrest(const FluxRow& row);

}  // namespace soilvdb::inline v0
