// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "bench/peers/neighbour_rules.h"

#include <cmath>

namespace soilvdb::bench {

bool NeighbourRule::sweep() {
  constexpr double kNoticed = 1e-3;  // cells
  constexpr int kWays[8][2] = {{1, 0}, {0, 1},  {-1, 0},  {0, -1},
                               {1, 1}, {-1, 1}, {-1, -1}, {1, -1}};
  const int x1 = ground_.x0 + ground_.nx, y1 = ground_.y0 + ground_.ny;
  bool moved = false;
  for (int x = ground_.x0; x < x1; ++x) {
    for (int y = ground_.y0; y < y1; ++y) {
      double most = kNoticed;
      int way = -1;
      for (int n = 0; n < neighbours_; ++n) {
        const int i = x + kWays[n][0], j = y + kWays[n][1];
        if (i < ground_.x0 || j < ground_.y0 || i >= x1 || j >= y1) continue;
        const double far = n < 4 ? 1 : std::numbers::sqrt2;
        const double excess = at(x, y) - at(i, j) - slope_ * far;
        if (excess > most) most = excess, way = n;
      }
      if (way < 0) continue;
      at(x, y) -= most / 2;
      at(x + kWays[way][0], y + kWays[way][1]) += most / 2;
      moved = true;
    }
  }
  return moved;
}

int NeighbourRule::relax() {
  int sweeps = 1;
  while (sweep()) ++sweeps;
  return sweeps;
}

double pyramid_error_deg(int neighbours, double slope) {
  return (std::atan(slope / std::cos(std::numbers::pi / neighbours)) - std::atan(slope)) / kDegree;
}

}  // namespace soilvdb::bench
