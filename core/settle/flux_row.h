// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What flows out of a row of columns, and what is left in it: the loops that take the time.
#pragma once

#include <cstddef>
#include <cstdint>

namespace soilvdb::inline v0 {

/// A part of a row of a FluxGrid, each array from the part's first column.
struct FluxRow {
  int columns;  ///< a multiple of 8
  std::ptrdiff_t stride;
  float limit, swell;
  const float *base, *bank, *soil, *brink[4];
  float *top, *depth;
  float *flux[8], *ahead[8], *out[4];
  /// Of each eight columns: 2 where something flows, 1 where something did
  /// until the last step.
  std::uint8_t* flows;
  const std::uint8_t* awake;  ///< of each eight columns: 0 where soil doesn't leave them
  std::uint8_t* moved;        ///< of each eight columns: 1 where heights changed in the last step
};

/// A step of all fluxes of a row.
/// @param uphill_by eight parts of by how much its momentum led uphill. In memory: who takes lanes
///        out of a register to return a sum leaves its upper half in use, for which code without
///        such registers that runs next waits
void push(const FluxRow& row, float momentum, float uphill_by[8]);
/// Soil, and so heights, after what flowed, of columns that it changed.
void settle(const FluxRow& row);

/// How far from rest columns are, in sides of the finest of them.
struct Unrest {
  float steep = 0;   ///< drop beyond the limit, of soil that is free to go
  float flux = 0;    ///< drop by which a flux isn't what it should be
  float hollow = 0;  ///< soil that a column gave without having it
};
Unrest unrest(const FluxRow& row);

}  // namespace soilvdb::inline v0
