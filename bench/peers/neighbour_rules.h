// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that slides by rules between neighbouring columns, as most simulators have it: Li and
// Moshell 1993, "Modeling soil"; Sumner, O'Brien and Hodgins 1999, "Animating sand, mud and snow".
#pragma once

#include "bench/earthmoving.h"

namespace soilvdb::bench {

/// Columns in which each one gives the neighbour that is too low by most half of what it is too low
/// by, until none is.
///
/// Known of it: a cone becomes a pyramid of as many sides as there are neighbours. Between two of
/// its directions its slope is too steep by 1 / cos(pi / neighbours).
class NeighbourRule {
 public:
  /// @param neighbours four or eight @param slope tangent of the angle of repose
  NeighbourRule(Heights ground, int neighbours, double slope)
      : ground_(std::move(ground)), neighbours_(neighbours), slope_(slope) {}

  const Heights& ground() const { return ground_; }
  void add(int x, int y, double cells) { at(x, y) += cells; }
  /// Goes over all columns once. @return whether something slid
  bool sweep();
  /// The same until nothing does; then nothing is steeper than repose by more than a thousandth of
  /// a cell. @return how often it went over them
  int relax();

 private:
  double& at(int x, int y) {
    return ground_.z[static_cast<std::size_t>((x - ground_.x0) * ground_.ny + y - ground_.y0)];
  }
  Heights ground_;
  int neighbours_;
  double slope_;
};

/// Slope by which a cone by such a rule is off in its worst direction, degrees.
double pyramid_error_deg(int neighbours, double slope);

}  // namespace soilvdb::bench
