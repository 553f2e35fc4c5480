// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The table is made by walking the outline of the surface over the cell's six faces, case by case,
// and by the divergence theorem: 3 V is the sum of x . n over the polygons and over what of each
// face lies in soil. Faces through the origin add nothing; the other three add their soil area.
#include "bench/peers/marching_cubes_volume.h"

#include <map>
#include <utility>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::bench {
namespace {

using Edge = std::pair<int, int>;  // corners, lower first

Edge edge(int a, int b) { return a < b ? Edge{a, b} : Edge{b, a}; }
Vec3 corner(int i) { return Vec3(i & 1, i >> 1 & 1, i >> 2 & 1); }
Vec3 middle(const Edge& e) { return (corner(e.first) + corner(e.second)) / 2; }

// Corners of each face, counter-clockwise seen from outside.
constexpr int kFaces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                              {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};

double volume(int mask) {
  const auto soil = [mask](int c) { return (mask >> c & 1) != 0; };
  std::map<Edge, Edge> next;  // of the surface's outline, soil to its left seen from outside
  double area = 0;            // of soil on the faces x = 1, y = 1, z = 1
  for (const auto& face : kFaces) {
    int count = 0;
    for (int i = 0; i < 4; ++i) count += soil(face[i]);
    const bool apart = count == 2 && soil(face[0]) == soil(face[2]);
    const bool far = (face[0] & face[1] & face[2] & face[3]) != 0;
    if (far) area += count == 1 ? 0.125 : count == 3 ? 0.875 : apart ? 0.25 : count / 4.0;
    for (int i = 0; i < 4; ++i) {
      // The outline leaves the soil run that ends at i and comes back where the run began.
      if (!soil(face[i]) || soil(face[(i + 1) % 4])) continue;
      int begin = i;
      while (soil(face[(begin + 3) % 4])) begin = (begin + 3) % 4;
      next[edge(face[i], face[(i + 1) % 4])] = edge(face[(begin + 3) % 4], face[begin]);
    }
  }
  double six_volumes = 2 * area;
  while (!next.empty()) {
    std::vector<Vec3> loop;
    Vec3 centre = Vec3::Zero();
    for (auto at = next.begin(); at != next.end();) {
      const Edge to = at->second;
      loop.push_back(middle(at->first));
      centre += loop.back();
      next.erase(at);
      at = next.find(to);
    }
    centre /= static_cast<double>(loop.size());
    // Seen from the air the loop runs the other way than on the faces it closes.
    for (std::size_t i = 0; i < loop.size(); ++i) {
      six_volumes += centre.dot(loop[(i + 1) % loop.size()].cross(loop[i]));
    }
  }
  return six_volumes / 6;
}

}  // namespace

const std::array<double, 256>& marching_cubes_volumes() {
  static const std::array<double, 256> table = [] {
    std::array<double, 256> all;
    for (int mask = 0; mask < 256; ++mask) all[static_cast<std::size_t>(mask)] = volume(mask);
    return all;
  }();
  return table;
}

}  // namespace soilvdb::bench
