// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How much of the plan a change covers, from what changed in each column.
#pragma once

#include <array>
#include <map>
#include <utility>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// What changed in a column, in the column's side.
struct ColumnChange {
  float thick = 0;       ///< volume over the column's area
  float wide = 0;        ///< most of a level, where it changed over several
  bool certain = false;  ///< not only by errors of counting
};

/// @param most that changed in a level of it
/// @param levels in which anything changed
ColumnChange changed_column(double thick, double most, int levels, bool certain);

/// What changed in eight by eight columns, at x * 8 + y.
using ChangedColumns = std::array<ColumnChange, 64>;

/// By the first column's indices, multiples of eight.
using ColumnChanges = std::map<std::pair<int, int>, ChangedColumns>;

/// Columns that changes cover, seen from above; those at the rim by the part of them that is
/// covered. Within 2 % of what is three columns wide and half a one thick or more (a layer one thin
/// on a steep slope: 3 %); by changes that are only certain beyond errors of counting within 5 %.
///
/// A column all of whose neighbours changed is covered. At the rim thickness goes on as further in,
/// straight, until the change ends: upright, or where thickness comes to nothing. Which of them it
/// is, and where, the column's volume says.
double changed_columns(const ColumnChanges& changes);

}  // namespace soilvdb::inline v0
