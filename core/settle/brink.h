// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil beside an edge of what it lies on.
#pragma once

#include "core/lattice/lanes.h"

namespace soilvdb::inline v0 {

/// Depth of soil that stays in the middle of a column beside a brink, where support bends to
/// something steeper than `slope`: soil lies up to the bend.
///
///     -._                       soil, at `slope`
///        `-._
///     ____   |`-._              held: from o, the column's middle, up to the soil
///         ```o--._`-._
///                 ```-`.        the bend, short_by sides from o
///                       `.      support, steeper
///
/// @param before, here, beyond the support's drops, in sides: to the column from the one before it,
///        to the next, and from that to the one after
/// @tparam V float or Lanes
template <typename V>
SOILVDB_INLINE V held_at_brink(V before, V here, V beyond, float slope) {
  const V none{};
  here = here > none ? here : none;
  beyond = beyond > none ? beyond : none;
  const V steepest = beyond > here ? beyond : here;
  // Of a slope that goes on the drops say where it begins, a step is between columns.
  const V short_by = beyond > here ? 1 - here / beyond : (1 - beyond / here) / 2;
  const V over = steepest - slope, under = slope - (before > none ? before : none);
  const V held = short_by * (over < under ? over : under);
  return ((steepest > slope) & (before < slope)) ? held : none;  // on steeper support it slides by
}

}  // namespace soilvdb::inline v0
