// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The plan area of a change, from the changes of columns.
#pragma once

#include <array>
#include <map>
#include <utility>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// The change of a column, in sides of the column.
struct ColumnChange {
  float thick = 0;       ///< volume over the column's area
  float wide = 0;        ///< largest change of a level, if several changed
  bool certain = false;  ///< larger than errors of counting
};

/// @param most largest change of a level
/// @param levels number of changed levels
ColumnChange changed_column(double thick, double most, int levels, bool certain);

/// The changes of eight by eight columns, at x * 8 + y.
using ChangedColumns = std::array<ColumnChange, 64>;

/// By the indices of the first column, multiples of eight.
using ColumnChanges = std::map<std::pair<int, int>, ChangedColumns>;

/// The number of columns that changes cover in plan; columns at the rim count by their covered
/// part. Within 2 % for changes at least three columns wide and half a column thick (3 % for a
/// layer one column thin on a steep slope); within 5 % if only changes beyond errors of counting
/// are certain.
///
/// A column is covered if all its neighbours changed. At the rim, thickness continues linearly from
/// further in until the change ends, with an upright face or with a thickness of 0. The column's
/// volume determines the kind and the place of this end.
double changed_columns(const ColumnChanges& changes);

}  // namespace soilvdb::inline v0
