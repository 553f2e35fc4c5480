// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cell/cell_samples.h"

namespace soilvdb::inline v0 {
namespace {

struct All {
  CellSamples of[kPatterns];
  All() {
    for (int pattern = 0; pattern < kPatterns; ++pattern) {
      CellSamples& s = of[pattern];
      s.points = pattern_points(pattern);
      for (int i = 0; i < 64; ++i) {
        const int at = i % 8 * 8 + i / 8;
        s.columns.x[at] = s.points.x[i];
        s.columns.y[at] = s.points.y[i];
        s.columns.z[at] = s.points.z[i];
      }
    }
  }
};

}  // namespace

const CellSamples* cell_samples() {
  static const All all;
  return all.of;
}

}  // namespace soilvdb::inline v0
