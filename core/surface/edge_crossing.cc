// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface/edge_crossing.h"

#include <algorithm>
#include <cmath>

#include "core/constants.h"

namespace soilvdb::inline v0 {
namespace {

/// The crossing by the model of one end of the edge. @return false if the model has none
bool seen_from(const CellModels& models, const std::uint8_t* soil, int id, int axis, int end,
               Crossing& c) {
  const int here = id + end * models.grid().step(axis);
  const CellModel* const m = models.find(here);
  if (m == nullptr) return false;
  const ActivePlane centre = m->at(0, 0, 0);
  // A centre that counts as inside a thin wall may lie just outside its face.
  const bool tied = (centre.signed_distance < 0) != (soil[here] != 0);
  const float slack = tied ? kThinWallTie : kCrossingSlack, from = static_cast<float>(end);
  float best = 2;
  for (int p = 0; p < m->planes(); ++p) {
    const CellPlane& plane = m->plane[p];
    const float slope[3] = {plane.nx, plane.ny, plane.nz};
    // Out of soil in the direction of the signs.
    const float outwards = soil[id] ? slope[axis] : -slope[axis];
    if (!(outwards > kMinCrossingCosine)) continue;
    const float along = plane.d / slope[axis];
    if (!(std::abs(along + from - 0.5f) <= 0.5f + slack)) continue;
    float q[3] = {0, 0, 0};
    q[axis] = along;
    if (std::abs(m->at(q[0], q[1], q[2]).signed_distance) > slack || std::abs(along) >= best)
      continue;
    best = std::abs(along);
    q[axis] = tied ? along + from : std::min(std::max(along + from, 0.0f), 1.0f);
    std::copy_n(q, 3, c.p);
    std::copy_n(slope, 3, c.n);
  }
  if (best < 2 || !tied) return best < 2;
  const CellPlane& face = m->plane[centre.plane];
  const float n[3] = {face.nx, face.ny, face.nz};
  for (int a = 0; a < 3; ++a) c.p[a] = -centre.signed_distance * n[a];
  c.p[axis] += from;
  std::copy_n(n, 3, c.n);
  return true;
}

}  // namespace

Crossing edge_crossing(const CellModels& models, const std::uint8_t* soil, int id, int axis) {
  Crossing seen[2];
  const bool below = seen_from(models, soil, id, axis, 0, seen[0]);
  const bool above = seen_from(models, soil, id, axis, 1, seen[1]);
  if (below && above) {
    // Each model is right in its own half.
    const bool first = seen[0].p[axis] <= 0.5f, second = seen[1].p[axis] >= 0.5f;
    if (first != second) return seen[first ? 0 : 1];
    Crossing c;
    float square = 0;
    for (int a = 0; a < 3; ++a) {
      c.p[a] = (seen[0].p[a] + seen[1].p[a]) / 2;
      c.n[a] = seen[0].n[a] + seen[1].n[a];
      square += c.n[a] * c.n[a];
    }
    const float scale = 1 / std::sqrt(std::max(square, kMinNormalSquare));
    for (float& v : c.n) v *= scale;
    return c;
  }
  if (below || above) return seen[below ? 0 : 1];
  Crossing c{{0, 0, 0}, {0, 0, 0}};
  c.p[axis] = 0.5f;
  c.n[axis] = soil[id] ? 1.0f : -1.0f;
  return c;
}

}  // namespace soilvdb::inline v0
