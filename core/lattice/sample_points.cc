// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The sample points of a cell.
#include <cmath>

#include "core/lattice/splitmix64.h"
#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {
namespace {

/// The rank-1 lattice i * (1, 7, 18) / 64 mod 1, turned and mirrored in 24 ways and shifted in 64.
///
/// The count of a cell cut by a plane has an error of kCountError, kWorstCountError in the worst
/// direction. Random points have 0.042 and 0.054, a shifted 4 x 4 x 4 grid 0.018 and 0.072, the
/// lattice without turns 0.017 and 0.049. The shifts are points of the Kronecker sequence of the
/// plastic number (Roberts 2018), which fills the cell evenly.
struct Patterns {
  CellPoints points[kPatterns];
  Patterns() {
    constexpr double kPlastic = 1.2207440846057596;  // root of x^4 = x + 1
    constexpr int kGenerator[3] = {1, 7, 18};
    constexpr int kTurns[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    for (int s = 0; s < kPatterns; ++s) {
      float* axes[3] = {points[s].x, points[s].y, points[s].z};
      for (int a = 0; a < 3; ++a) {
        const int step = kGenerator[kTurns[s % 6][a]] * ((s / 6 >> a & 1) != 0 ? -1 : 1);
        const double shift = s * std::pow(kPlastic, -(a + 1)) + 0.5 / 64;
        for (int i = 0; i < 64; ++i) {
          const double v = i * step / 64.0 + shift;
          axes[a][i] = static_cast<float>(v - std::floor(v));
        }
      }
    }
  }
};

const Patterns kAll;

}  // namespace

int sample_pattern(const Coord3& voxel) {
  static_assert(kLatticePeriod == 1 << 16);
  const auto wrapped = [](int i) { return std::uint32_t(std::int16_t(i)); };
  const std::uint64_t xy = std::uint64_t{wrapped(voxel.x())} << 32 | wrapped(voxel.y());
  return static_cast<int>(splitmix64(splitmix64(xy) + wrapped(voxel.z())) >> 58);
}

const CellPoints& pattern_points(int pattern) { return kAll.points[pattern]; }

const CellPoints& sample_points(const Coord3& voxel) { return kAll.points[sample_pattern(voxel)]; }

}  // namespace soilvdb::inline v0
