// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The cube between eight voxel centres: its corners, edges and faces, and the sheets of a surface
// in it.
#pragma once

#include <array>
#include <cstdint>

namespace soilvdb::inline v0 {

// Corners of a dual cell are x + 2 y + 4 z, its edges 4 axis + p + 2 q, where p and q are 0 or 1
// along the next two axes, its faces 2 axis + side.
inline constexpr int kNext[3] = {1, 2, 0}, kNextButOne[3] = {2, 0, 1};

constexpr int low_corner(int edge) {
  const int axis = edge / 4;
  return (edge & 1) << kNext[axis] | (edge >> 1 & 1) << kNextButOne[axis];
}

/// The edge of a dual cell between two corners that differ in one axis.
constexpr int edge_between(int a, int b) {
  const int axis = (a ^ b) == 1 ? 0 : (a ^ b) == 2 ? 1 : 2, low = a & b;
  return 4 * axis + (low >> kNext[axis] & 1) + 2 * (low >> kNextButOne[axis] & 1);
}

/// The corners of each face in turn around it.
struct Faces {
  int corner[6][4];
  constexpr Faces() : corner() {
    for (int f = 0; f < 6; ++f) {
      const int axis = f / 2, base = (f & 1) << axis;
      const int p = 1 << kNext[axis], q = 1 << kNextButOne[axis];
      corner[f][0] = base;
      corner[f][1] = base | p;
      corner[f][2] = base | p | q;
      corner[f][3] = base | q;
    }
  }
};
inline constexpr Faces kFaces;

/// Joins the crossed edges to sheets, by segments on the faces. @param corners in soil
/// @param between faces with all edges crossed whose middle is in soil
constexpr std::array<std::int8_t, 12> sheets(unsigned corners, unsigned between) {
  std::array<std::int8_t, 12> group{};
  const auto soil = [&](int corner) { return (corners >> corner & 1) != 0; };
  for (int e = 0; e < 12; ++e) {
    const int a = low_corner(e), b = a | 1 << (e / 4);
    group[static_cast<std::size_t>(e)] = static_cast<std::int8_t>(soil(a) != soil(b) ? e : -1);
  }
  const auto join = [&](int a, int b) {
    const std::int8_t from = group[static_cast<std::size_t>(b)],
                      to = group[static_cast<std::size_t>(a)];
    for (std::int8_t& g : group) {
      if (g == from) g = to;
    }
  };
  for (int f = 0; f < 6; ++f) {
    const int* const c = kFaces.corner[f];
    int edges[4] = {}, crossed[4] = {}, n = 0;
    for (int k = 0; k < 4; ++k) {
      edges[k] = edge_between(c[k], c[(k + 1) & 3]);
      if (group[static_cast<std::size_t>(edges[k])] >= 0) crossed[n++] = edges[k];
    }
    if (n == 2) join(crossed[0], crossed[1]);
    if (n < 4) continue;
    // Segments cut off the corners that differ from the middle.
    const int k = soil(c[0]) != ((between >> f & 1) != 0) ? 0 : 1;
    join(edges[(k + 3) & 3], edges[k]);
    join(edges[k + 1], edges[(k + 2) & 3]);
  }
  return group;
}

/// The sheets of a dual cell by its corners in soil, where no face is ambiguous.
struct Sheets {
  struct Case {
    std::array<std::int8_t, 12> group{};
    bool ambiguous = false;
  } of[256];
  constexpr Sheets() : of() {
    for (unsigned corners = 0; corners < 256; ++corners) {
      of[corners].group = sheets(corners, 0);
      for (const auto& c : kFaces.corner) {
        const unsigned a = corners >> c[0] & 1;
        of[corners].ambiguous |=
            (corners >> c[1] & 1) != a && (corners >> c[2] & 1) == a && (corners >> c[3] & 1) != a;
      }
    }
  }
};
inline constexpr Sheets kSheets;

}  // namespace soilvdb::inline v0
