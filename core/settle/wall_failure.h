// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Cuts in bank soil that are too high for its cohesion, on ground given as heights of columns.
#pragma once

#include <functional>
#include <vector>

#include "core/settle/columns.h"

namespace soilvdb::inline v0 {

/// Strength of bank soil, in units of its weight and of the columns' sides.
struct BankStrength {
  double cohesion = 0;  ///< over unit weight, sides
  double friction = 0;  ///< tangent of the angle of friction
  double swell = 1;     ///< loose volume over bank volume: soil on a bank weighs less by it

  /// Lower cuts never fail: half the critical height of a vertical cut, because ground that falls
  /// off again behind a cut may weigh twice as much as level ground.
  double least_height() const;
};

/// The soil that remains standing.
struct WallFailure {
  struct Column {
    double height;     ///< top of the standing bank; its firm height if no bank fails
    Vec2 slope{0, 0};  ///< of the plane along which it fails
  };
  std::vector<Column> columns;
  Eigen::AlignedBox2i failed;  ///< columns of which soil fails; empty: all stands
  bool at_border = false;      ///< a plane may continue beyond the ground, which is too small
};

/// How much lower a column's bank is than it was, sides; 0: no foot can be there.
using DugDepth = std::function<double(int x, int y)>;

/// Finds the planes along which soil slides off behind feet of cuts: those through a foot that need
/// the most cohesion, if more than there is (Culmann 1866: c = W sin(theta - phi) / (L cos phi) for
/// a wedge of weight W on a plane of length L and angle theta). Wedges are tested in vertical
/// slices across the face at each foot, in one of 32 directions, and in those between it and the
/// faces beside it. Loose soil on a wedge has weight but no strength. What stands in a gap between
/// columns that fail fails with them.
///
/// Accuracy: a straight cut fails within one side of its critical height. Its crest is within two
/// sides of its plane's upper end if it is some 20 sides high. Caveats: each slice stands or falls
/// alone, so narrow pits fail like long trenches. Planes much longer or higher than the depth dug
/// at their foot are not tested: a slope that stood before a small cut stands after. No water, no
/// cracks, no curved surfaces.
///
/// @param ground heights in sides; rigid columns stand, and nothing fails through them
/// @param feet columns of the ground in which to look for feet of cuts
WallFailure find_wedge_failure(const Columns& ground, const Eigen::AlignedBox2i& feet,
                               const BankStrength& strength, const DugDepth& dug);

}  // namespace soilvdb::inline v0
