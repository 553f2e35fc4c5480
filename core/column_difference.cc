// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/column_difference.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/column_gains.h"

namespace soilvdb {
namespace {

using Column = ColumnGrid::Column;
using Gains = std::map<Column, Gain>;

const Soil& coarsest(const Soil& a, const Soil& b) {
  const Soil* found = &a;
  for (const Soil* top : {&a, &b})
    for (const Soil* soil = top; soil != nullptr; soil = soil->base().soil())
      if (soil->voxel_size_m() > found->voxel_size_m()) found = soil;
  return *found;
}

/// What part of a column at the rim changed: as much less of it as it changed less than the one
/// beside it.
double fraction(const Gains& changed, const Column& column, double gain_m3) {
  double most = 0;
  bool inside = true;
  for (int d = 0; d < 9; ++d) {
    const auto at = changed.find({column.first + d / 3 - 1, column.second + d % 3 - 1});
    inside &= at != changed.end();
    if (at != changed.end()) most = std::max(most, std::abs(at->second.m3));
  }
  return inside ? 1 : std::abs(gain_m3) / most;
}

}  // namespace

Difference column_difference(const Soil& before, const Soil& after) {
  const Soil& coarse = coarsest(before, after);
  const ColumnGrid grid{coarse.origin().head<2>(), coarse.voxel_size_m()};
  Gains all;
  for_each_gain(before, after, /*same_base=*/false, grid,
                [&](const Column& column, const Gain& gain) { all[column].add(gain); });
  Difference d;
  Gains changed;
  for (const auto& [column, gain] : all) {
    const double sigma = std::sqrt(gain.variance);
    (gain.m3 < 0 ? d.cut_m3 : d.fill_m3) += std::abs(gain.m3);
    d.net_m3 += gain.m3;
    d.error_m3 += sigma;
    if (std::abs(gain.m3) > 2 * sigma) changed.emplace(column, gain);
  }
  for (const auto& [column, gain] : changed) {
    d.area_m2 += fraction(changed, column, gain.m3) * grid.side_m * grid.side_m;
    const Vec2 middle = grid.origin + grid.side_m * Vec2(column.first, column.second);
    const Vec2 half = Vec2::Constant(grid.side_m / 2);
    d.box.extend(Eigen::AlignedBox2d(middle - half, middle + half));
  }
  return d;
}

}  // namespace soilvdb
