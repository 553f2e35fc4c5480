// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Up to three planes that bound the soil in and around a cell.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/cell/cell_plane.h"
#include "core/constants.h"

namespace soilvdb::inline v0 {

/// Soil as a combination of the half spaces a, b, c below planes.
enum class BooleanOp : std::uint8_t {
  kOne,     ///< a
  kAnd,     ///< a and b
  kOr,      ///< a or b
  kAndAnd,  ///< a and b and c
  kOrOr,    ///< a or b or c
  kAndOr,   ///< (a and b) or c
  kOrAnd,   ///< (a or b) and c
};

/// Number of planes of an operation.
constexpr int planes_of(BooleanOp op) {
  return op == BooleanOp::kOne ? 1 : op <= BooleanOp::kOr ? 2 : 3;
}

/// Signed distance to soil bounded by planes, negative in soil, with the plane that determines it.
struct ActivePlane {
  float signed_distance;
  int plane;
};

struct CellModel {
  BooleanOp op = BooleanOp::kOne;
  bool solved = false;  ///< false: the cell's planes are unknown
  int wrong = 0;        ///< samples of the 27 cells around that it does not explain
  CellPlane plane[3];

  int planes() const { return planes_of(op); }

  ActivePlane at(float x, float y, float z) const {
    ActivePlane a{plane[0].signed_distance(x, y, z), 0};
    if (op == BooleanOp::kOne) return a;
    const ActivePlane b{plane[1].signed_distance(x, y, z), 1};
    const bool first_and =
        op == BooleanOp::kAnd || op == BooleanOp::kAndAnd || op == BooleanOp::kAndOr;
    a = (first_and ? b.signed_distance > a.signed_distance : b.signed_distance < a.signed_distance)
            ? b
            : a;
    if (op <= BooleanOp::kOr) return a;
    const ActivePlane c{plane[2].signed_distance(x, y, z), 2};
    const bool second_and = op == BooleanOp::kAndAnd || op == BooleanOp::kOrAnd;
    return (second_and ? c.signed_distance > a.signed_distance
                       : c.signed_distance < a.signed_distance)
               ? c
               : a;
  }

  /// True if the centre of the cell is in soil.
  bool soil() const {
    const ActivePlane here = at(0, 0, 0);
    if (std::abs(here.signed_distance) < kThinWallTie) {
      const CellPlane& face = plane[here.plane];
      for (int p = 0; p < planes(); ++p) {
        if (face.along(plane[p].nx, plane[p].ny, plane[p].nz) > kOppositeCosine) continue;
        const float thickness = face.d + plane[p].d;  // of a slot below zero
        if (std::abs(thickness) < kThinWallThickness) return thickness > 0;
      }
    }
    return here.signed_distance < 0;
  }
};

}  // namespace soilvdb::inline v0
