// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Up to three planes that say where soil is in and about a cell.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/cell/cell_plane.h"
#include "core/constants.h"

namespace soilvdb::inline v0 {

/// How soil is made of the half spaces a, b, c below planes.
enum class Join : std::uint8_t {
  kOne,     ///< a
  kAnd,     ///< a and b
  kOr,      ///< a or b
  kAndAnd,  ///< a and b and c
  kOrOr,    ///< a or b or c
  kAndOr,   ///< (a and b) or c
  kOrAnd,   ///< (a or b) and c
};

/// How many planes a join takes.
constexpr int planes_of(Join join) { return join == Join::kOne ? 1 : join <= Join::kOr ? 2 : 3; }

/// Signed distance to soil made of planes, negative in soil, and which plane says so.
struct Active {
  float beyond;
  int plane;
};

struct CellModel {
  Join join = Join::kOne;
  bool solved = false;  ///< else the cell's planes are not known
  int wrong = 0;        ///< samples of the 27 cells around that it doesn't explain
  CellPlane plane[3];

  int planes() const { return planes_of(join); }

  Active at(float x, float y, float z) const {
    Active a{plane[0].beyond(x, y, z), 0};
    if (join == Join::kOne) return a;
    const Active b{plane[1].beyond(x, y, z), 1};
    const bool first_and = join == Join::kAnd || join == Join::kAndAnd || join == Join::kAndOr;
    a = (first_and ? b.beyond > a.beyond : b.beyond < a.beyond) ? b : a;
    if (join <= Join::kOr) return a;
    const Active c{plane[2].beyond(x, y, z), 2};
    const bool second_and = join == Join::kAndAnd || join == Join::kOrAnd;
    return (second_and ? c.beyond > a.beyond : c.beyond < a.beyond) ? c : a;
  }

  /// Is the centre of the cell in soil?
  bool soil() const {
    const Active here = at(0, 0, 0);
    if (std::abs(here.beyond) < kThinWallTie) {
      const CellPlane& face = plane[here.plane];
      for (int p = 0; p < planes(); ++p) {
        if (face.along(plane[p].nx, plane[p].ny, plane[p].nz) > kOppositeCosine) continue;
        const float thickness = face.d + plane[p].d;  // of a slot below zero
        if (std::abs(thickness) < kThinWallThickness) return thickness > 0;
      }
    }
    return here.beyond < 0;
  }
};

}  // namespace soilvdb::inline v0
